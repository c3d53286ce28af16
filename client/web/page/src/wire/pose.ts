// The pose as the gateway's binary message carries it: 176 bytes, little-endian. The layout is that of
// client/web/source/pose_bytes.h.
import type { Vec3 } from "./messages";
export type { Vec3 };
export type Quat = [number, number, number, number]; // x, y, z, w

export const kPoseBytes = 176;
const kKind = 1;

// Numbered as the enumerators of client/sdk/pose.h.
export const kProxyModes = ["unknown", "free", "constrained", "ejecting", "fault", "suspended", "inside"] as const;
export const kForceStates = ["unknown", "off", "ramp in", "on", "held", "fault", "stopped"] as const;
export const kForceReasons = [
  "unknown", "none", "operator", "docked", "uncalibrated", "stale", "deadlines", "device",
  "position", "force", "speed", "stop call", "stop button", "replay",
] as const;

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
  mode: (typeof kProxyModes)[number];
  forceState: (typeof kForceStates)[number];
  forceReason: (typeof kForceReasons)[number];
  hip: Vec3;
  scpH: Vec3;
  scpHNormal: Vec3 | null;
  scpV: Vec3 | null;
  orientation: Quat; // the stylus points along its -z
  force: Vec3;
  forceLimit: number;
  density: number; // at SCP_H
  isovalue: number;
  buttons: number;
  missedTicks: number;
  updateUs: number;
  settingsRevision: number;
  volumeRevision: number;
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
    mode: kProxyModes[view.getUint8(2)] ?? "unknown",
    forceState: kForceStates[view.getUint8(3)] ?? "unknown",
    forceReason: kForceReasons[view.getUint8(156)] ?? "unknown",
    hip: vector(56),
    scpH: vector(68),
    scpHNormal: flags & 2 ? vector(80) : null,
    scpV: flags & 4 ? vector(92) : null,
    orientation: [single(104), single(108), single(112), single(116)],
    force: vector(120),
    forceLimit: single(132),
    density: single(136),
    isovalue: single(140),
    buttons: view.getUint32(144, true),
    missedTicks: view.getUint32(148, true),
    updateUs: single(152),
    settingsRevision: double(40),
    volumeRevision: double(48),
  };
}

export function length(v: Vec3): number {
  return Math.hypot(v[0], v[1], v[2]);
}

export function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
