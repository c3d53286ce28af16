// What palpated does now, in words and numbers.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import { distance, length } from "../wire/pose";
import { badgeOf } from "./badge";
import { find, make, setText } from "./dom";
import { bytesText, fixed, forcesText, grouped, kReplay, modeText, valueText } from "./words";

const kRows = {
  stream: ["Stream", "Whether what you see is now"],
  stylus: ["Stylus", "What the haptic loop does with the proxy"],
  force: ["Force", "On the hand, and the most that the device gives now"],
  forces: ["Forces", "Whether the device may push"],
  penetration: ["Penetration", "From the stylus tip to the proxy, in contact"],
  density: ["Value at the proxy", "The volume's value at SCP_H"],
  missed: ["Missed ticks", "Ticks that the haptic loop missed since palpated started"],
  update: ["Haptic update", "Time that the newest tick took"],
  series: ["Series", "Volumes that follow each other in time"],
  recording: ["Recording", "palpated records what happens"],
  memory: ["Volume here", "How much memory of this page and of its graphics card the volume takes"],
  user: ["You", "Your name here, and what you may set"],
} as const;
type Row = keyof typeof kRows;

function seriesText(state: State): string {
  const { series } = state;
  if (!series || !series.frames) return "";
  const frame = Math.min(series.frames, Math.floor(series.position_frames) + 1);
  const motion = series.playing ? `playing at ${fixed(series.rate_hz, 1, "Hz")}` : "paused";
  return `frame ${frame} of ${series.frames}, ${motion}`;
}

function recordingText(state: State): string {
  const { recording } = state;
  if (!recording?.running) return "";
  const lost = recording.lost_ticks > 0 ? `, ${grouped(recording.lost_ticks)} ticks lost` : "";
  return `running for ${fixed(recording.seconds, 0, "s")}${lost}`;
}

function userText(state: State): string {
  const { hello } = state;
  if (!hello) return "";
  const labels = hello.may_steer.map((key) => hello.settings.find((s) => s.key === key)?.label ?? key);
  return labels.length > 0 ? `${hello.user}, may set: ${labels.join(", ")}` : `${hello.user}, watching`;
}

function textsOf(state: State, copy: VolumeCopy): Record<Row, string> {
  const { pose } = state;
  return {
    stream: badgeOf(state).words,
    stylus: pose ? modeText(pose) : "",
    force: pose ? `${fixed(length(pose.force), 2, "N")} of ${fixed(pose.forceLimit, 1, "N")}` : "",
    forces: pose ? forcesText(pose) : "",
    penetration: pose ? (pose.contact ? fixed(distance(pose.hip, pose.scpH), 2, "mm") : "no contact") : "",
    density: pose ? valueText(pose.density, state.volume?.unit) : "",
    missed: pose ? grouped(pose.missedTicks) : "",
    update: pose ? fixed(pose.updateUs, 1, "µs") : "",
    series: seriesText(state),
    recording: recordingText(state),
    memory: copy.shape ? bytesText(copy.memoryBytes) : "",
    user: userText(state),
  };
}

// Returns a function to call several times a second: numbers that change at 60 Hz cannot be read.
export function showValues(root: HTMLElement, state: State, copy: VolumeCopy): () => void {
  const list = find(root, "values");
  const rows = (Object.keys(kRows) as Row[]).map((name) => {
    const [label, title] = kRows[name];
    const row = { name, term: make("dt", { title }, label), value: make("dd") };
    list.append(row.term, row.value);
    return row;
  });
  const mode = find(root, "mode");
  const touch = find(root, "touch");
  return () => {
    const texts = textsOf(state, copy);
    for (const { name, term, value } of rows) {
      setText(value, texts[name]);
      term.hidden = value.hidden = texts[name] === "";
    }
    const { pose } = state;
    touch.hidden = !pose;
    if (!pose) return;
    const { kind } = badgeOf(state);
    const last = kind === "live" || kind === kReplay ? "" : "last known: ";
    setText(mode, `${last}${modeText(pose)} · ${forcesText(pose)}`);
    setText(touch, `${last}${pose.contact ? `contact ${fixed(length(pose.force), 2, "N")}` : "no contact"}`);
  };
}
