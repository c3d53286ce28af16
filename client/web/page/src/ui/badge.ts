// Whether what is shown is live, old, of a replay, or without its volume: a badge with a sign and words. Only changes of its
// kind are announced to screen readers, and only those that last.
import type { State } from "../state";
import { find, setAttribute, setText } from "./dom";
import { fixed, kReplay } from "./words";

type Tone = "acting" | "idle" | "caution" | "alarm";
interface Badge {
  tone: Tone;
  words: string;
  kind: string; // announced when it changes
}

const kOldMs = 300; // a page that draws at 60 Hz over a slow network is still live
const kAnnounceAfterMs = 1000;

// A shape for each tone, for those who do not tell the colours apart: disc, ring, triangle, square.
const kSigns: Record<Tone, string> = {
  acting: "M6 2a4 4 0 1 0 .01 0z",
  idle: "M6 2a4 4 0 1 0 .01 0z",
  caution: "M6 2 10.5 10h-9z",
  alarm: "M2.5 2.5h7v7h-7z",
};

function ageText(ageMs: number): string {
  return ageMs < 60_000 ? `${fixed(ageMs / 1000, 1, "s")} old` : `${Math.floor(ageMs / 60_000)} min old`;
}

export function badgeOf(state: State): Badge {
  const { link, connection, pose } = state;
  const badge = (tone: Tone, words: string, kind = words) => ({ tone, words, kind });
  if (link === "login") return badge("idle", "not logged in");
  if (link === "connecting") return badge("caution", "connecting");
  if (link === "lost") return badge("alarm", "connection lost, trying again");
  if (connection?.state === "lost") return badge("alarm", connection.why);
  if (connection?.state === "connecting") return badge("caution", connection.why);
  if (!pose) return badge("caution", "no pose yet");
  const ageMs = state.poseAgeMs();
  if (ageMs > kOldMs) return badge("caution", ageText(ageMs), "the stream is old");
  if (pose.replayed) return badge("caution", kReplay);
  const missing = state.missingVolume();
  return missing ? badge("caution", missing, "the volume is missing") : badge("acting", "live");
}

// Returns a function to call several times a second.
export function showBadge(state: State): () => void {
  const chip = find("badge");
  const words = find("badge-words");
  const sign = chip.querySelector("path")!;
  const announcement = find("announcement");
  const stage = find("stage");
  let kind = "";
  let sinceMs = 0;
  const update = () => {
    const badge = badgeOf(state);
    setText(words, badge.words);
    setAttribute(chip, "data-tone", badge.tone);
    setAttribute(chip, "title", state.link === "lost" && state.linkWhy ? state.linkWhy : badge.words);
    setAttribute(sign, "d", kSigns[badge.tone]);
    stage.toggleAttribute("data-replay", badge.kind === kReplay);
    const now = performance.now();
    if (badge.kind !== kind) [kind, sinceMs] = [badge.kind, now];
    else if (now - sinceMs > kAnnounceAfterMs) setText(announcement, kind);
  };
  state.watch(["link", "connection"], update);
  return update;
}
