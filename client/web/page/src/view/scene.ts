// Everything drawn besides the volume, with three.js: the box with the patient's letters, the points, the force and
// the stylus. Parts that have a size on the screen keep it when the camera moves. What the surface hides of points,
// links and force shows through faintly.
import {
  AmbientLight, BoxGeometry, BufferGeometry, CanvasTexture, ConeGeometry, CylinderGeometry, DirectionalLight,
  Float32BufferAttribute, GreaterDepth, Group, LatheGeometry, LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial,
  Object3D, OctahedronGeometry, PerspectiveCamera, Quaternion, Scene, SphereGeometry, Sprite, SpriteMaterial, Vector2,
  Vector3,
} from "three";

import type { Vec3 } from "../wire/messages";
import type { Pose } from "../wire/pose";
import { halfView } from "./camera";
import type { Camera, Size } from "./camera";
import { add, apply, column, norm, scale, subtract } from "./geometry";
import type { AffineMap } from "./geometry";
import { faceLetters } from "./patient_axes";

// Colours of the desktop viewer (client/view/scene/overlay.h).
const kHipColor = 0xeb4b3c;
const kScpHColor = 0x3cc85a;
const kScpVColor = 0x4682ff;
const kForceColor = 0xffcd3c;
const kSpringColor = 0xf5f5f5; // HIP to SCP_H
const kGapColor = 0xa0c3ff; // SCP_H to SCP_V
const kBoxColor = 0x808c9e;

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
function seenThrough(geometry: BufferGeometry, color: number): Mesh {
  const mesh = new Mesh(geometry, new MeshLambertMaterial({ color }));
  const behind = new MeshLambertMaterial({
    color, transparent: true, opacity: kBehindOpacity, depthFunc: GreaterDepth, depthWrite: false,
  });
  mesh.add(new Mesh(geometry, behind));
  return mesh;
}

// From y = 0 to y = 1, of radius 1.
function unitTube(): BufferGeometry {
  return new CylinderGeometry(1, 1, 1, 12).translate(0, 0.5, 0);
}

function spriteOf(letter: string, color: string): Sprite {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d")!;
  context.font = "600 56px sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = color;
  context.fillText(letter, 32, 34);
  return new Sprite(new SpriteMaterial({ map: new CanvasTexture(canvas), transparent: true }));
}

export class PalpationScene {
  readonly camera = new PerspectiveCamera();
  readonly scene = new Scene();
  private readonly box = new Group();
  private letters: { sprite: Sprite; face: Vec3; outward: Vec3 }[] = [];
  private readonly hip = seenThrough(new SphereGeometry(1, 24, 16), kHipColor);
  private readonly scpH = seenThrough(new OctahedronGeometry(1.25), kScpHColor);
  private readonly scpV = seenThrough(new BoxGeometry(1.6, 1.6, 1.6), kScpVColor);
  private readonly spring = seenThrough(unitTube(), kSpringColor);
  private readonly gap = seenThrough(unitTube(), kGapColor);
  private readonly shaft = seenThrough(unitTube(), kForceColor);
  private readonly head = seenThrough(new ConeGeometry(1, 1, 16).translate(0, 0.5, 0), kForceColor);
  private readonly stylus = new Group();
  private readonly touched = new Group();
  private readonly light = new DirectionalLight(0xffffff, 2);

  constructor() {
    this.camera.matrixAutoUpdate = false;
    for (const [color, profile] of kStylusParts) {
      const points = profile.map(([along, radius]) => new Vector2(radius, along));
      const part = new Mesh(new LatheGeometry(points, 24), new MeshLambertMaterial({ color }));
      part.rotation.x = Math.PI / 2; // from y to z
      this.stylus.add(part);
    }
    this.touched.add(this.hip, this.scpH, this.scpV, this.spring, this.gap, this.shaft, this.head, this.stylus);
    this.touched.visible = false;
    this.scene.add(this.box, this.touched, new AmbientLight(0xffffff, 1.2), this.light);
  }

  // The box follows the outer faces of the outermost voxels. `worldFromIndex`: leads to LPS; null: no letters.
  setBox(deviceFromIndex: AffineMap, size: Vec3, worldFromIndex: AffineMap | null, letterColor: string): void {
    this.clearBox();
    const corner = (n: number): Vec3 => [0, 1, 2].map((axis) => ((n >> axis) & 1 ? size[axis] : 0) - 0.5) as Vec3;
    const edges: number[] = [];
    for (let n = 0; n < 8; ++n) {
      for (const bit of [1, 2, 4]) {
        if (!(n & bit)) edges.push(...apply(deviceFromIndex, corner(n)), ...apply(deviceFromIndex, corner(n | bit)));
      }
    }
    const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(edges, 3));
    this.box.add(new LineSegments(geometry, new LineBasicMaterial({ color: kBoxColor, transparent: true, opacity: 0.6 })));
    if (!worldFromIndex) return;
    const centre = apply(deviceFromIndex, scale(0.5, subtract(size, [1, 1, 1])));
    for (const { letter, axis, sign } of faceLetters(worldFromIndex)) {
      const toFace = scale(0.5 * sign * size[axis], column(deviceFromIndex, axis));
      const sprite = spriteOf(letter, letterColor);
      this.letters.push({ sprite, face: add(centre, toFace), outward: scale(1 / norm(toFace), toFace) });
      this.box.add(sprite);
    }
  }

  // `size` and `pixelRatio`: of the canvas.
  update(pose: Pose | null, camera: Camera, size: Size, pixelRatio: number): void {
    const [right, up, back] = camera.axes().map((axis) => new Vector3(...axis));
    const eye = new Vector3(...camera.eye());
    this.camera.matrix.makeBasis(right, up, back).setPosition(eye);
    this.camera.updateMatrixWorld(true);
    // From above and from the left of the eye.
    this.light.position.copy(back).addScaledVector(up, 0.7).addScaledVector(right, -0.5);
    // The size of a CSS pixel at a point, mm.
    const perDepth = (2 * halfView(size)[1] * pixelRatio) / Math.max(size[1], 1);
    const pixelAt = (p: Vec3) => perDepth * Math.max(eye.clone().sub(new Vector3(...p)).dot(back), 1e-3);
    for (const { sprite, face, outward } of this.letters) {
      const height = kLetterHeight * pixelAt(face);
      sprite.position.set(...add(face, scale(height, outward)));
      sprite.scale.setScalar(height * 1.4);
      // A letter on the line of sight would tell nothing, and cover what is looked at.
      sprite.visible = Math.abs(new Vector3(...outward).dot(back)) < 0.8;
    }
    this.touched.visible = pose !== null;
    if (pose) this.updatePose(pose, pixelAt);
  }

  private updatePose(pose: Pose, pixelAt: (p: Vec3) => number): void {
    const pointAt = (mesh: Object3D, p: Vec3 | null) => {
      mesh.visible = p !== null;
      if (p) mesh.position.set(...p);
      if (p) mesh.scale.setScalar(kPointRadius * pixelAt(p));
    };
    // In free motion HIP and SCP_H are the same point.
    const apart = pose.contact && norm(subtract(pose.hip, pose.scpH)) > 0;
    pointAt(this.hip, pose.hip);
    pointAt(this.scpH, apart ? pose.scpH : null);
    pointAt(this.scpV, pose.scpV);
    this.span(this.spring, pose.hip, apart ? pose.scpH : null, kLinkRadius * pixelAt(pose.hip));
    this.span(this.gap, pose.scpH, pose.scpV, kLinkRadius * pixelAt(pose.scpH));
    const pixel = pixelAt(pose.scpH);
    const force = norm(pose.force);
    const lengthPx = pose.forceLimit > 0 ? (kGreatestForce * force) / pose.forceLimit : 0;
    const headPx = Math.min(16, lengthPx);
    const at = (px: number) => (lengthPx > 1 ? add(pose.scpH, scale((px * pixel) / force, pose.force)) : null);
    this.span(this.shaft, pose.scpH, at(lengthPx - headPx), 2.2 * pixel);
    this.span(this.head, at(lengthPx - headPx) ?? pose.scpH, at(lengthPx), 6 * pixel);
    this.stylus.position.set(...pose.hip);
    this.stylus.quaternion.copy(new Quaternion(...pose.orientation).normalize());
  }

  // Stretches a body that is 1 long between two points.
  private span(mesh: Mesh, from: Vec3, to: Vec3 | null, radius: number): void {
    const along = to && new Vector3(...to).sub(new Vector3(...from));
    const length = along?.length() ?? 0;
    mesh.visible = length > 0;
    if (!along || length === 0) return;
    mesh.position.set(...from);
    mesh.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), along.divideScalar(length));
    mesh.scale.set(radius, length, radius);
  }

  private clearBox(): void {
    for (const { sprite } of this.letters) {
      sprite.material.map?.dispose();
      sprite.material.dispose();
    }
    this.letters = [];
    this.box.clear();
  }
}
