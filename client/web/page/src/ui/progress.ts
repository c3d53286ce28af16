// How much of the volume is here, and why there is less than all.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import { find, paced, setText } from "./dom";
import { bytesText, grouped } from "./words";

const kTellAfterS = 1;

// "" before it can be told.
function timeLeft({ fetching, groupsLeft }: VolumeCopy): string {
  const here = fetching.groups - groupsLeft;
  const sinceS = (performance.now() - fetching.sinceMs) / 1000;
  if (here <= 0 || sinceS < kTellAfterS) return "";
  const leftS = Math.ceil((groupsLeft * sinceS) / here);
  return leftS < 100 ? `, about ${leftS} s left` : `, about ${Math.ceil(leftS / 60)} min left`;
}

// Words, "" if everything is shown; and how much is here, if it comes.
function progressOf(state: State, copy: VolumeCopy): [string, number?] {
  const { volume } = state;
  // The badge says what is lost.
  const isKnown = !volume || state.connection?.state === "connected";
  const missing = state.copy && isKnown ? state.missingVolume() : "";
  if (missing) return [missing];
  const bricksLeft = state.copy?.bricks_left ?? 0;
  if (bricksLeft > 0) return [`the gateway waits for ${grouped(bricksLeft)} bricks`];
  if (copy.whyOverview) {
    const points = `each point is the mean of ${[copy.factor, copy.factor, copy.factor].join(" × ")} voxels`;
    return [`shown from the overview (${points}): ${copy.whyOverview}`];
  }
  if (volume && !copy.shape) return ["the volume comes"];
  if (copy.groupsLeft === 0) return [""];
  const share = 1 - copy.groupsLeft / copy.groupsAll;
  const [here, all] = [share, 1].map((part) => bytesText(part * copy.groupsAll * copy.groupBytes));
  const overview = copy.isOverview ? "overview; " : "";
  return [`${overview}${here} of ${all}, ${Math.floor(100 * share)} %${timeLeft(copy)}`, share];
}

// Returns a function to call several times a second: the time left grows while nothing comes.
export function showProgress(state: State, copy: VolumeCopy): () => void {
  const box = find("progress");
  const bar = find<HTMLProgressElement>("progress-bar");
  const request = paced(10, () => {
    const [words, share] = progressOf(state, copy);
    box.hidden = words === "";
    bar.hidden = share === undefined;
    bar.value = share ?? 0;
    setText(find("progress-words"), words);
  });
  state.on(["volume", "copy", "copyProgress", "picture"], request);

  const notice = find("no-picture");
  state.watch("picture", () => {
    notice.hidden = state.whyNoPicture === "";
    find("main").classList.toggle("flat", state.whyNoPicture !== "");
    setText(find("no-picture-why"), state.whyNoPicture);
  });
  return request;
}
