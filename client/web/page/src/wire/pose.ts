// The pose as the gateway's binary message carries it: 176 bytes, little-endian. The layout is that of
// client/web/source/pose_bytes.h; what the page does not show is not read.
import type { Vec3 } from "./messages";
import { kForceReason, kForceState, kProxyMode } from "./words";

export const kPoseBytes = 176;
const kKind = 1;

function nameOf<Names extends { unknown: string }>(names: Names, number: number): keyof Names {
  return (Object.keys(names) as (keyof Names)[])[number] ?? "unknown";
}

// Lengths in mm of D (x right, y up, z to the user), forces in N, values in data units.
export interface Pose {
  sequence: number;
  tick: number;
  timeMs: number; // palpated's monotonic clock
  sentMs: number; // the gateway's monotonic clock
  ageMs: number; // at sentMs; NaN if palpated is on another machine
  contact: boolean;
  freeAbove: boolean; // the stylus is free above the isovalue
  fresh: boolean; // the gateway hears from palpated
  replayed: boolean; // of a recording that is replayed; the forces are those of now
  mode: keyof typeof kProxyMode;
  forceState: keyof typeof kForceState;
  forceReason: keyof typeof kForceReason;
  hip: Vec3;
  scpH: Vec3;
  scpV: Vec3 | null;
  orientation: [number, number, number, number]; // x, y, z, w; the stylus points along its -z
  force: Vec3;
  forceLimit: number;
  density: number; // at SCP_H
  isovalue: number;
  missedTicks: number;
  updateUs: number;
}

// Returns null if the bytes are no pose of this layout.
export function decodePose(bytes: ArrayBuffer): Pose | null {
  if (bytes.byteLength !== kPoseBytes) return null;
  const view = new DataView(bytes);
  if (view.getUint8(0) !== kKind) return null;
  const flags = view.getUint8(1);
  const single = (at: number) => view.getFloat32(at, true);
  const double = (at: number) => view.getFloat64(at, true);
  const vector = (at: number): Vec3 => [single(at), single(at + 4), single(at + 8)];
  return {
    sequence: view.getUint32(4, true),
    tick: double(8),
    timeMs: double(16),
    sentMs: double(24),
    ageMs: double(32),
    contact: (flags & 1) !== 0,
    freeAbove: (flags & 8) !== 0,
    fresh: (flags & 16) !== 0,
    replayed: (flags & 32) !== 0,
    mode: nameOf(kProxyMode, view.getUint8(2)),
    forceState: nameOf(kForceState, view.getUint8(3)),
    forceReason: nameOf(kForceReason, view.getUint8(156)),
    hip: vector(56),
    scpH: vector(68),
    scpV: flags & 4 ? vector(92) : null,
    orientation: [single(104), single(108), single(112), single(116)],
    force: vector(120),
    forceLimit: single(132),
    density: single(136),
    isovalue: single(140),
    missedTicks: view.getUint32(148, true),
    updateUs: single(152),
  };
}
