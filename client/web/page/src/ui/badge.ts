// Whether what is shown is live, old or of a replay: a badge with a sign and words. Only changes of its
// kind are announced to screen readers, and only those that last.
import type { State } from "../state";
import { find, setAttribute, setText } from "./dom";
import { fixed, kReplay } from "./words";

export type Tone = "acting" | "idle" | "caution" | "alarm";
export interface Badge {
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
  switch (state.link) {
    case "login":
      return { tone: "idle", words: "not logged in", kind: "not logged in" };
    case "connecting":
      return { tone: "caution", words: "connecting", kind: "connecting" };
    case "lost":
      return { tone: "alarm", words: "connection lost, trying again", kind: "connection lost, trying again" };
    case "open":
      break;
  }
  const connection = state.connection;
  if (connection && connection.state !== "connected") {
    return { tone: connection.state === "lost" ? "alarm" : "caution", words: connection.why, kind: connection.why };
  }
  if (!state.pose) return { tone: "caution", words: "no pose yet", kind: "no pose yet" };
  const ageMs = state.poseAgeMs();
  if (ageMs > kOldMs) return { tone: "caution", words: ageText(ageMs), kind: "the stream is old" };
  if (state.pose.replayed) return { tone: "caution", words: kReplay, kind: kReplay };
  return { tone: "acting", words: "live", kind: "live" };
}

// Returns a function to call several times a second.
export function showBadge(root: HTMLElement, state: State): () => void {
  const chip = find(root, "badge");
  const words = find(root, "badge-words");
  const sign = chip.querySelector("path")!;
  const announcement = find(root, "announcement");
  const stage = find(root, "stage");
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
    if (badge.kind !== kind) {
      kind = badge.kind;
      sinceMs = now;
    } else if (now - sinceMs > kAnnounceAfterMs) {
      setText(announcement, kind);
    }
  };
  state.on("link", update);
  state.on("connection", update);
  update();
  return update;
}
