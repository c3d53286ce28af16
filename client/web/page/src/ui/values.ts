// What palpated does now, in words and numbers.
import type { State } from "../state";
import { norm, subtract } from "../view/geometry";
import { whereInLayers } from "../view/layers";
import { touches } from "../view/tool";
import type { VolumeCopy } from "../volume/copy";
import { kProxyMode } from "../wire/words";
import { nameOf } from "../wire/contract";
import type { Pose } from "../wire/contract";
import { badgeOf } from "./badge";
import { find, make, setText } from "./dom";
import { bytesText, fixed, forcesText, grouped, kOfReplay, kReplay, kTicksPerS, valueText } from "./words";

function seriesText(state: State): string {
  const { series } = state;
  if (!series?.frames) return "";
  const frame = Math.min(series.frames, Math.floor(series.positionFrames) + 1);
  const motion = series.playing ? `playing at ${fixed(series.rateHz, 1, "Hz")}` : "paused";
  return `frame ${frame} of ${series.frames}, ${motion}`;
}

function settingsText({ settings }: State): string {
  if (settings?.replayed) return kOfReplay;
  return settings?.notKept ? "not kept for palpated's next start" : "";
}

function recordingText(state: State): string {
  const { recording } = state;
  if (!recording?.running) return "";
  const lost = recording.lostTicks > 0 ? `, ${grouped(recording.lostTicks)} ticks lost` : "";
  return `running for ${fixed(recording.ticks / kTicksPerS, 0, "s")}${lost}`;
}

function ballText({ toolRadiusMm }: Pose, state: State): string {
  const ball = state.settings?.ball;
  const made = ball?.isAwaited ? `; another one is being made (${fixed(100 * (ball.shareDone ?? 0), 0, "%")})` : "";
  if (toolRadiusMm > 0) return fixed(toolRadiusMm, 2, "mm") + made;
  return made && `a point${made}`;
}

function toolText(pose: Pose, state: State): string {
  const tool = state.settings?.settings.tool;
  const made = tool?.ball.length && state.settings?.ball?.isAwaited ? "its field is being made" : "";
  if (!pose.toolOrientation || !tool) return made;
  const touching = tool.ball.filter((_, n) => touches(pose, n)).length;
  return `${tool.name || "without a name"}, ${touching} of ${tool.ball.length} balls touch`;
}

function userText(state: State): string {
  const { hello } = state;
  if (!hello) return "";
  const labels = hello.may_steer.map((key) => hello.settings.find((s) => s.key === key)?.label ?? key);
  return labels.length > 0 ? `${hello.user}, may set: ${labels.join(", ")}` : `${hello.user}, watching`;
}

// A label, what it means, and the text; none: there is nothing to say.
const kRows: [string, string, (pose: Pose | null, state: State, copy: VolumeCopy) => string | null][] = [
  ["Stream", "Whether what you see is now", (_, state) => badgeOf(state).words],
  ["Stylus", "What the haptic loop does with the proxy", (pose) => pose && kProxyMode[nameOf(kProxyMode, pose.mode)]],
  ["Layers", "Where the proxy is among the surfaces that are felt one behind the other", (_, state) => whereInLayers(state)],
  ["Ball at the tip", "Its radius on the device", (pose, state) => pose && ballText(pose, state)],
  ["Tool", "The rigid tool in the hand, and how many of its balls hold it back", (pose, state) => pose && toolText(pose, state)],
  ["Force", "On the hand, and the most that the device gives now",
    (pose) => pose && `${fixed(norm(pose.forceN), 2, "N")} of ${fixed(pose.forces.limitN, 1, "N")}`],
  ["Torque", "On the hand, and the most that the device gives now",
    (pose) => pose && (pose.forces.torqueLimitNMm > 0
      ? `${fixed(norm(pose.torqueNMm ?? [0, 0, 0]), 1, "N·mm")} of ${fixed(pose.forces.torqueLimitNMm, 0, "N·mm")}` : "")],
  ["Forces", "Whether the device may push", (pose) => pose && forcesText(pose)],
  ["Penetration", "From the stylus tip to the proxy, in contact",
    (pose) => pose && (pose.contact ? fixed(norm(subtract(pose.hipMm, pose.scpHMm)), 2, "mm") : "no contact")],
  ["Value at the proxy", "The volume's value at SCP_H", (pose, state) => pose && valueText(pose.density, state.volume?.unit)],
  ["Missed ticks", "Ticks that the haptic loop missed since palpated started", (pose) => pose && grouped(pose.missedTicks)],
  ["Haptic update", "Time that the newest tick took", (pose) => pose && fixed(1e-3 * pose.updateNs, 1, "µs")],
  ["Settings", "Whether a replay shows them, and whether palpated keeps them for its next start", (_, state) => settingsText(state)],
  ["Series", "Volumes that follow each other in time", (_, state) => seriesText(state)],
  ["Recording", "palpated records what happens", (_, state) => recordingText(state)],
  ["Volume here", "How much memory of this page and of its graphics card the volume takes",
    (_, __, copy) => copy.shape && bytesText(copy.memoryBytes)],
  ["You", "Your name here, and what you may set", (_, state) => userText(state)],
];

// Returns a function to call several times a second: numbers that change at 60 Hz cannot be read.
export function showValues(state: State, copy: VolumeCopy): () => void {
  const list = find("values");
  const rows = kRows.map(([label, title, text]) => {
    const [term, value] = [make("dt", { title }, label), make("dd")];
    list.append(term, value);
    return { term, value, text };
  });
  const mode = find("mode");
  const touch = find("touch");
  return () => {
    const { pose } = state;
    for (const { term, value, text } of rows) {
      setText(value, text(pose, state, copy) ?? "");
      term.hidden = value.hidden = value.textContent === "";
    }
    touch.hidden = !pose;
    if (!pose) return;
    const { kind } = badgeOf(state);
    const last = kind === "live" || kind === kReplay ? "" : "last known: ";
    setText(mode, `${last}${kProxyMode[nameOf(kProxyMode, pose.mode)]} · ${forcesText(pose)}`);
    setText(touch, `${last}${pose.contact ? `contact ${fixed(norm(pose.forceN), 2, "N")}` : "no contact"}`);
  };
}
