// Numbers and states in words.
import type { SteeringMessage } from "../wire/messages";
import type { Pose } from "../wire/pose";

const kThinSpace = "\u202f";

// 4096: "4 096".
export function grouped(count: number): string {
  return String(Math.round(count)).replace(/\B(?=(\d{3})+$)/g, kThinSpace);
}

export function withUnit(text: string, unit: string): string {
  return unit ? `${text} ${unit}` : text;
}

// A value of the volume or of a setting, with five digits that count.
export function valueText(value: number, unit = ""): string {
  if (!Number.isFinite(value)) return "–";
  return withUnit(String(Number(value.toPrecision(5))).replace("-", "−"), unit);
}

export function fixed(value: number, digits: number, unit: string): string {
  return Number.isFinite(value) ? withUnit(value.toFixed(digits), unit) : "–";
}

export function bytesText(bytes: number): string {
  return bytes < 2 ** 30 ? `${Math.ceil(bytes / 2 ** 20)} MiB` : `${(bytes / 2 ** 30).toFixed(1)} GiB`;
}

const kModes: Record<Pose["mode"], string> = {
  unknown: "unknown",
  free: "in free space",
  constrained: "held by the surface",
  ejecting: "the surface moved over the tip, the proxy is being moved out",
  fault: "nothing is felt after a fault",
  suspended: "nothing is felt: the volume is moved",
  inside: "nothing is felt: the tip is inside the material until it is pulled out",
};

export function modeText(pose: Pose): string {
  return kModes[pose.mode];
}

// The sentence that everybody is told in a replay; guests do not learn who replays what.
export const kReplay = "replay: forces are off";

const kForceStates: Record<Pose["forceState"], string> = {
  unknown: "forces unknown",
  off: "forces off",
  "ramp in": "forces are coming on",
  on: "forces on",
  held: "forces held back",
  fault: "forces off after a fault",
  stopped: "forces stopped",
};

const kForceReasons: Record<Pose["forceReason"], string> = {
  unknown: "",
  none: "",
  operator: "not enabled",
  docked: "the stylus rests in its holder",
  uncalibrated: "the device is not calibrated",
  stale: "the device's readings are late",
  deadlines: "the haptic loop is late",
  device: "the device is gone or broken",
  position: "a position was no number",
  force: "a force was no number",
  speed: "the stylus moved too fast",
  "stop call": "emergency stop",
  "stop button": "emergency stop by the stylus",
  replay: "until the replay ends",
};

export function forcesText(pose: Pose): string {
  const why = pose.forceState === "on" ? "" : kForceReasons[pose.forceReason];
  const text = why ? `${kForceStates[pose.forceState]}: ${why}` : kForceStates[pose.forceState];
  if (!pose.replayed) return text;
  return pose.forceReason === "replay" ? `${kReplay} ${why}` : `${kReplay}; ${text}`;
}

// Who set this setting last, or "" if no guest did.
export function lastChangeText(steering: SteeringMessage | null, key: string): string {
  const change = steering?.changes.filter((c) => c.key === key).at(-1);
  return change ? `set by ${change.user}` : "";
}
