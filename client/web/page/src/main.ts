// Puts the page together.
import { State } from "./state";
import type { View } from "./state";
import { buildInterface } from "./ui/index";
import { Viewport } from "./view/viewport";
import { readFragment, writeFragment } from "./view/fragment";
import { kBudgetBytes, VolumeCopy } from "./volume/copy";
import type { Manifest } from "./volume/manifest";
import { Meanwhile } from "./wire/meanwhile";
import { Room } from "./wire/room";

const kFragmentMs = 500; // browsers limit how often a page may change its address

const fragment = readFragment(location.hash);
const state = new State();
Object.assign(state.view, fragment.view);
const room = new Room(state);
new Meanwhile(state);
const budgetBytes = fragment.budgetMiB === null ? kBudgetBytes : fragment.budgetMiB * 2 ** 20;
const copy = new VolumeCopy(state, budgetBytes);

const canvas = document.querySelector<HTMLCanvasElement>("#viewport")!;
state.whyNoPicture = Viewport.problem(canvas);
const viewport = state.whyNoPicture === "" ? new Viewport(canvas, state, "target" in fragment.view) : null;
copy.target = viewport;

const isAimed = () => viewport?.isAimed || "target" in fragment.view;
const hashNow = () => writeFragment(room.roomKey, fragment.budgetMiB, state.view, isAimed());

async function savePng(): Promise<void> {
  const picture = await viewport?.png();
  if (!picture) return;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(picture);
  link.download = "palpate.png";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

buildInterface(document.body, state, room, copy, {
  resetView(): void {
    state.view.follow = false;
    viewport?.resetView();
  },
  savePng: () => void savePng(),
  shareLink: () => new URL(hashNow(), location.href).href,
});

let fragmentTimer = 0;
const writeAddress = () => {
  fragmentTimer ||= window.setTimeout(() => {
    fragmentTimer = 0;
    history.replaceState(null, "", hashNow());
  }, kFragmentMs);
};
state.on("view", writeAddress);
state.on("link", writeAddress); // the room's key may be another one
// A link to the same page with another room or view.
window.addEventListener("hashchange", () => location.reload());

if (fragment.room !== null) room.start({ room: fragment.room });
state.emit("view");

// For those who measure: when the first pictures of the overview and of the whole volume were there.
state.on("picture", () => {
  const isOverview = copy.contentHash === "" && viewport?.hasPicture;
  if (!isOverview && !viewport?.caster.isCurrent) return;
  const name = isOverview ? "palpate-overview" : "palpate-volume";
  if (performance.getEntriesByName(name).length === 0) performance.mark(name);
});

// For tests and scripts.
const palpate = {
  state,
  copy,
  room,
  viewport,
  caster: viewport?.caster ?? null,
  // Distances from the eye to the surface in mm of the picture that is shown, the top row first.
  distances: () => viewport?.caster.distances() ?? new Float32Array(0),
  // The finest picture of what is wanted now is shown.
  isFine: () => viewport !== null && viewport.isFine(),
  setView(view: Partial<View>): void {
    Object.assign(state.view, view);
    state.emit("view");
  },
  // Calls `listener` whenever a whole manifest is shown.
  onShown: (listener: (manifest: Manifest) => void) => copy.onShown(listener),
};
Object.assign(window, { palpate });
