// Numbers and states in words.
import type { SteeringMessage } from "../wire/messages";
import { nameOf } from "../wire/contract";
import type { Pose } from "../wire/contract";
import { kForceReason, kForceState } from "../wire/words";

export const kTicksPerS = 1000; // of the haptic loop
const kThinSpace = "\u202f";

// 4096: "4 096".
export function grouped(count: number): string {
  return String(Math.round(count)).replace(/\B(?=(\d{3})+$)/g, kThinSpace);
}

function withUnit(text: string, unit: string): string {
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
  const [count, unit] = bytes < 2 ** 30 ? [bytes / 2 ** 20, "MiB"] : [bytes / 2 ** 30, "GiB"];
  return fixed(count, count < 10 ? 1 : 0, unit);
}

// The sentence that everybody is told in a replay; guests do not learn who replays what.
export const kReplay = "replay: forces are off";
// Beside what is recorded, which nobody can set.
export const kOfReplay = "of the replay";

export function forcesText(pose: Pose): string {
  const [state, reason] = [nameOf(kForceState, pose.forces.state), nameOf(kForceReason, pose.forces.reason)];
  const why = state === "on" ? "" : kForceReason[reason];
  const text = why ? `${kForceState[state]}: ${why}` : kForceState[state];
  if (!pose.replayed) return text;
  return reason === "replay" ? `${kReplay} ${why}` : `${kReplay}; ${text}`;
}

// Who set this setting last, or "" if no guest did.
export function lastChangeText(steering: SteeringMessage | null, key: string): string {
  const change = steering?.changes.filter((c) => c.key === key).at(-1);
  return change ? `set by ${change.user}` : "";
}
