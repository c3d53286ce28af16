// How much of the volume is here, and why there is less than all.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import { find, paced, setText } from "./dom";
import { grouped } from "./words";

export interface Progress {
  words: string; // "": everything is shown
  share: number | null; // of the groups; null: there is nothing to wait for
}

export function progressOf(state: State, copy: VolumeCopy): Progress {
  const { volume } = state;
  if (volume?.loading) return { words: `palpated loads: ${volume.loading}`, share: null };
  if (volume && volume.size === undefined) return { words: "no volume yet", share: null };
  // The badge says what is lost.
  const problem = state.connection?.state === "connected" ? (state.copy?.problem ?? "") : "";
  if (problem) return { words: `the volume does not follow: ${problem}`, share: null };
  if ((state.copy?.bricks_left ?? 0) > 0) {
    return { words: `the gateway waits for ${grouped(state.copy!.bricks_left)} bricks`, share: null };
  }
  if (copy.whyOverview) {
    const points = `each point is the mean of ${[copy.factor, copy.factor, copy.factor].join(" × ")} voxels`;
    return { words: `shown from the overview (${points}): ${copy.whyOverview}`, share: null };
  }
  if (copy.groupsLeft > 0) {
    const here = copy.groupsAll - copy.groupsLeft;
    const overview = copy.isOverview ? "overview; " : "";
    return { words: `${overview}${grouped(here)} of ${grouped(copy.groupsAll)} groups`, share: here / copy.groupsAll };
  }
  return { words: "", share: null };
}

export function showProgress(root: HTMLElement, state: State, copy: VolumeCopy): void {
  const box = find(root, "progress");
  const bar = find<HTMLProgressElement>(root, "progress-bar");
  const words = find(root, "progress-words");
  const request = paced(10, () => {
    const progress = progressOf(state, copy);
    box.hidden = progress.words === "";
    bar.hidden = progress.share === null;
    bar.value = progress.share ?? 0;
    setText(words, progress.words);
  });
  for (const topic of ["volume", "copy", "copyProgress", "picture"] as const) state.on(topic, request);

  const notice = find(root, "no-picture");
  const flatten = () => {
    notice.hidden = state.whyNoPicture === "";
    find(root, "main").classList.toggle("flat", state.whyNoPicture !== "");
    setText(find(root, "no-picture-why"), state.whyNoPicture);
  };
  state.on("picture", flatten);
  flatten();
}
