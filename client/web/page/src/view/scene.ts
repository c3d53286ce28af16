// Everything drawn besides the volume, with three.js: the box with the names of its sides, the points, the force and
// the stylus. Parts that have a size on the screen keep it when the camera moves. What the surface hides of points,
// links and force shows through faintly.
import * as three from "three";

import type { Vec3 } from "../wire/messages";
import type { Pose } from "../wire/contract";
import { halfView } from "./camera";
import type { Camera, Size } from "./camera";
import { add, column, compose, dot, fromColumns, matrixOf, norm, normalized, scale, subtract } from "./geometry";
import type { AffineMap } from "./geometry";
import type { FaceLabel } from "./patient_axes";
import { ToolBody } from "./tool";
import type { Tool } from "./tool";

// CSS pixels.
const kPointRadius = 7;
const kGreatestForce = 220; // the arrow's length at the force's limit
const kLinkRadius = 1;
const kLetterHeight = 16;
const kBehindOpacity = 0.5;

// Radius at a distance from the tip, mm: of the stylus's tip, grip and body.
const kStylusParts: [number, [number, number][]][] = [
  [0xcdd0d4, [[0, 0], [1, 0.35], [14, 2.3]]],
  [0x808a98, [[14, 2.3], [15, 2.7], [26, 2.9], [26.6, 2.6]]],
  [0x424a58, [[26.6, 2.6], [27.2, 2.9], [66, 2.9], [67.8, 2.6], [69.2, 1.8], [70, 0]]],
];

// A mesh that shows through what hides it.
function seenThrough(geometry: three.BufferGeometry, color: number): three.Mesh {
  const mesh = new three.Mesh(geometry, new three.MeshLambertMaterial({ color }));
  const behind = new three.MeshLambertMaterial({
    color, transparent: true, opacity: kBehindOpacity, depthFunc: three.GreaterDepth, depthWrite: false,
  });
  mesh.add(new three.Mesh(geometry, behind));
  return mesh;
}

// From y = 0 to y = 1, of radius 1.
function unitTube(): three.BufferGeometry {
  return new three.CylinderGeometry(1, 1, 1, 12).translate(0, 0.5, 0);
}

function spriteOf(label: string, color: string): three.Sprite {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d")!;
  context.font = `600 ${label.length > 1 ? 40 : 56}px sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = color;
  context.fillText(label, 32, 34, 62);
  const map = new three.CanvasTexture(canvas);
  map.colorSpace = three.SRGBColorSpace;
  return new three.Sprite(new three.SpriteMaterial({ map, transparent: true }));
}

export class PalpationScene {
  readonly camera = new three.PerspectiveCamera();
  readonly scene = new three.Scene();
  private readonly box = new three.Group();
  private readonly edges = new three.LineSegments(
    new three.EdgesGeometry(new three.BoxGeometry(1, 1, 1)),
    new three.LineBasicMaterial({ color: 0x808c9e, transparent: true, opacity: 0.6 }),
  );
  private letters: { sprite: three.Sprite; face: Vec3; outward: Vec3 }[] = [];
  // In the desktop viewer's colours (client/view/drawing/overlay.h).
  private readonly hip = seenThrough(new three.SphereGeometry(1, 24, 16), 0xeb4b3c);
  private readonly scpH = seenThrough(new three.BoxGeometry(1.6, 1.6, 1.6), 0x3cc85a);
  private readonly scpV = seenThrough(new three.OctahedronGeometry(1.25), 0x4682ff);
  private readonly spring = seenThrough(unitTube(), 0xf5f5f5); // HIP to SCP_H
  private readonly gap = seenThrough(unitTube(), 0xa0c3ff); // SCP_H to SCP_V
  private readonly shaft = seenThrough(unitTube(), 0xffcd3c); // of the force
  private readonly head = seenThrough(new three.ConeGeometry(1, 1, 16).translate(0, 0.5, 0), 0xffcd3c);
  private readonly ball = new three.Mesh(
    new three.SphereGeometry(1, 48, 32),
    new three.MeshLambertMaterial({ color: 0x3cc85a, transparent: true, opacity: 0.35, depthWrite: false }),
  );
  private readonly stylus = new three.Group();
  private readonly tool = new ToolBody();
  private readonly touched = new three.Group();
  private readonly light = new three.DirectionalLight(0xffffff, 2);

  constructor() {
    this.camera.matrixAutoUpdate = this.edges.matrixAutoUpdate = false;
    for (const [color, profile] of kStylusParts) {
      const points = profile.map(([along, radius]) => new three.Vector2(radius, along));
      const part = new three.Mesh(new three.LatheGeometry(points, 24), new three.MeshLambertMaterial({ color }));
      part.rotation.x = Math.PI / 2; // from y to z
      this.stylus.add(part);
    }
    this.touched.add(this.hip, this.scpH, this.scpV, this.spring, this.gap, this.shaft, this.head, this.stylus, this.ball, this.tool.group);
    this.touched.visible = false;
    this.scene.add(this.box, this.touched, new three.AmbientLight(0xffffff, 1.2), this.light);
  }

  // The box follows the outer faces of the outermost voxels.
  setBox(deviceFromIndex: AffineMap, size: Vec3, labels: FaceLabel[], color: string): void {
    for (const { sprite } of this.letters) sprite.material.map?.dispose();
    this.letters = [];
    this.box.clear();
    const [x, y, z] = size;
    // The edges are those of a cube of edge 1 around the origin.
    const fromCube = compose(deviceFromIndex, [x, 0, 0, (x - 1) / 2, 0, y, 0, (y - 1) / 2, 0, 0, z, (z - 1) / 2]);
    this.edges.matrix.copy(matrixOf(fromCube));
    this.box.add(this.edges);
    for (const { label, axis, sign } of labels) {
      const toFace = scale(0.5 * sign, column(fromCube, axis));
      const sprite = spriteOf(label, color);
      this.letters.push({ sprite, face: add(column(fromCube, 3), toFace), outward: normalized(toFace) });
      this.box.add(sprite);
    }
  }

  // `size` and `pixelRatio`: of the canvas.
  // `tool`: that is felt, where the pose says that one is.
  update(pose: Pose | null, tool: Tool | null, camera: Camera, size: Size, pixelRatio: number): void {
    const [right, up, back] = camera.axes();
    const eye = camera.eye();
    this.camera.matrix.copy(matrixOf(fromColumns(right, up, back, eye)));
    this.camera.updateMatrixWorld(true);
    // From above and from the left of the eye.
    this.light.position.set(...add(back, subtract(scale(0.7, up), scale(0.5, right))));
    // The size of a CSS pixel at a point, mm.
    const perDepth = (2 * halfView(size)[1] * pixelRatio) / Math.max(size[1], 1);
    const pixelAt = (p: Vec3) => perDepth * Math.max(dot(subtract(eye, p), back), 1e-3);
    for (const { sprite, face, outward } of this.letters) {
      const height = kLetterHeight * pixelAt(face);
      sprite.position.set(...add(face, scale(height, outward)));
      sprite.scale.setScalar(height * 1.4);
      // A letter on the line of sight would tell nothing, and cover what is looked at.
      sprite.visible = Math.abs(dot(outward, back)) < 0.8;
    }
    this.touched.visible = pose !== null;
    if (pose) this.updatePose(pose, tool, pixelAt);
  }

  private updatePose(pose: Pose, tool: Tool | null, pixelAt: (p: Vec3) => number): void {
    const pointAt = (mesh: three.Object3D, p: Vec3 | null) => {
      mesh.visible = p !== null;
      if (!p) return;
      mesh.position.set(...p);
      mesh.scale.setScalar(kPointRadius * pixelAt(p));
    };
    const { hipMm: hip, scpHMm: scpH, scpVMm: scpV = null } = pose;
    // In free motion HIP and SCP_H are the same point.
    const apart = pose.contact && norm(subtract(hip, scpH)) > 0;
    pointAt(this.hip, hip);
    pointAt(this.scpH, apart ? scpH : null);
    pointAt(this.scpV, scpV);
    this.span(this.spring, hip, apart ? scpH : null, kLinkRadius * pixelAt(hip));
    this.span(this.gap, scpH, scpV, kLinkRadius * pixelAt(scpH));
    const pixel = pixelAt(scpH);
    const force = norm(pose.forceN);
    const lengthPx = pose.forces.limitN > 0 ? (kGreatestForce * force) / pose.forces.limitN : 0;
    const headPx = Math.min(16, lengthPx);
    const at = (px: number) => (lengthPx > 1 ? add(scpH, scale((px * pixel) / force, pose.forceN)) : null);
    this.span(this.shaft, scpH, at(lengthPx - headPx), 2.2 * pixel);
    this.span(this.head, at(lengthPx - headPx) ?? scpH, at(lengthPx), 6 * pixel);
    this.ball.visible = pose.toolRadiusMm > 0;
    this.ball.position.set(...scpH);
    this.ball.scale.setScalar(Math.max(pose.toolRadiusMm, 1e-6));
    this.stylus.visible = !this.tool.update(pose, tool, pose.forces.torqueLimitNMm, pixelAt);
    this.stylus.position.set(...hip);
    this.stylus.quaternion.copy(new three.Quaternion(...pose.stylusOrientation).normalize());
  }

  // Stretches a body that is 1 long between two points.
  private span(mesh: three.Mesh, from: Vec3, to: Vec3 | null, radius: number): void {
    const along = subtract(to ?? from, from);
    const length = norm(along);
    mesh.visible = length > 0;
    if (length === 0) return;
    mesh.position.set(...from);
    mesh.quaternion.setFromUnitVectors(mesh.up, new three.Vector3(...normalized(along)));
    mesh.scale.set(radius, length, radius);
  }
}
