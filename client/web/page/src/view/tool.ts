// A rigid tool in the page's scene: as it is felt, where the hand wants it, which balls hold it back, and the torque.
import * as three from "three";

import type { Vec3 } from "../wire/messages";
import type { GuestFacts, Pose } from "../wire/contract";
import { norm, scale, subtract } from "./geometry";

export type Tool = NonNullable<GuestFacts["settings"]["settings"]["tool"]>;

// In the desktop viewer's colours (client/view/drawing/overlay.cpp).
const kSteel = 0xbcc0c8;
const kCarving = 0xd6ba78;
const kTouching = 0x3cc85a;
const kLeastRadius = 2.5; // CSS pixels, of a point
const kSameMm = 0.05; // the hand is where the tool is, but for this
const kSameRad = 0.005;
const kTorqueRadius = 60; // CSS pixels
const kLeastTorque = 0.01; // of the greatest

const kSphere = new three.SphereGeometry(1, 24, 16);

function ballOf(color: number): three.Mesh<three.BufferGeometry, three.MeshLambertMaterial> {
  return new three.Mesh(kSphere, new three.MeshLambertMaterial({ color }));
}

export function touches(pose: Pose, ball: number): boolean {
  return ((pose.touchingBalls >> BigInt(ball)) & 1n) === 1n;
}

export class ToolBody {
  readonly group = new three.Group();
  private readonly felt = new three.Group();
  private readonly wanted = new three.Group();
  private readonly torque = new three.Mesh(new three.BufferGeometry(), new three.MeshLambertMaterial({ color: 0xffcd3c }));
  private tool: Tool | null = null;
  private arc = 0; // of the torque's geometry

  constructor() {
    this.group.add(this.felt, this.wanted, this.torque);
  }

  // Whether the pose has a tool, which is drawn in place of the stylus.
  update(pose: Pose, tool: Tool | null, maxTorqueNMm: number, pixelAt: (p: Vec3) => number): boolean {
    if (tool !== this.tool) this.take(tool);
    const turned = pose.toolOrientation;
    this.group.visible = Boolean(turned && tool?.ball.length);
    if (!this.group.visible) return false;
    const feltTurn = new three.Quaternion(...turned!).normalize();
    const wantedTurn = new three.Quaternion(...pose.stylusOrientation).normalize();
    this.felt.position.set(...pose.scpHMm);
    this.felt.quaternion.copy(feltTurn);
    this.wanted.position.set(...pose.hipMm);
    this.wanted.quaternion.copy(wantedTurn);
    this.wanted.visible = norm(subtract(pose.hipMm, pose.scpHMm)) > kSameMm || feltTurn.angleTo(wantedTurn) > kSameRad;
    const least = kLeastRadius * pixelAt(pose.scpHMm);
    tool!.ball.forEach((ball, n) => {
      const mesh = this.felt.children[n] as ReturnType<typeof ballOf>;
      mesh.material.color.setHex(touches(pose, n) ? kTouching : ball.carves ? kCarving : kSteel);
      mesh.scale.setScalar(Math.max(ball.radiusMm, least));
      this.wanted.children[n].scale.setScalar(Math.max(ball.radiusMm, least));
    });
    this.updateTorque(pose, maxTorqueNMm, kTorqueRadius * pixelAt(pose.scpHMm));
    return true;
  }

  private take(tool: Tool | null): void {
    this.tool = tool;
    this.felt.clear();
    this.wanted.clear();
    for (const { centerMm = [0, 0, 0] } of tool?.ball ?? []) {
      const felt = ballOf(kSteel);
      const wanted = new three.Mesh(kSphere, new three.MeshBasicMaterial({
        color: 0xf5f5f5, transparent: true, opacity: 0.12, depthWrite: false,
      }));
      for (const mesh of [felt, wanted]) mesh.position.fromArray(centerMm);
      this.felt.add(felt);
      this.wanted.add(wanted);
    }
  }

  // An arc about the torque's axis; at the greatest torque three quarters of a circle.
  private updateTorque(pose: Pose, maxNMm: number, radiusMm: number): void {
    const torque = norm(pose.torqueNMm ?? [0, 0, 0]);
    this.torque.visible = maxNMm > 0 && torque > kLeastTorque * maxNMm;
    if (!this.torque.visible) return;
    const arc = 1.5 * Math.PI * Math.min(1, Math.round((40 * torque) / maxNMm + 0.5) / 40);
    if (arc !== this.arc) {
      this.torque.geometry.dispose();
      this.torque.geometry = new three.TorusGeometry(1, 0.04, 8, 48, arc);
      this.arc = arc;
    }
    this.torque.position.set(...pose.scpHMm);
    const axis = new three.Vector3(...scale(1 / torque, pose.torqueNMm!));
    this.torque.quaternion.setFromUnitVectors(new three.Vector3(0, 0, 1), axis);
    this.torque.scale.setScalar(radiusMm);
  }
}
