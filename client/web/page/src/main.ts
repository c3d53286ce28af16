// Puts the page together.
import { State } from "./state";
import { make } from "./ui/dom";
import { buildInterface } from "./ui/index";
import { Viewport } from "./view/viewport";
import { readFragment, writeFragment } from "./view/fragment";
import { kBudgetMiB, VolumeCopy } from "./volume/copy";
import { Meanwhile } from "./wire/meanwhile";
import { Room } from "./wire/room";

const kFragmentMs = 500; // browsers limit how often a page may change its address

const fragment = readFragment(location.hash);
const state = new State();
Object.assign(state.view, fragment.view);
state.linkIsovalue = fragment.isovalue;
state.linkVolume = fragment.volume;
const room = new Room(state);
new Meanwhile(state);
const copy = new VolumeCopy(state, fragment.budgetMiB ?? kBudgetMiB);

const canvas = document.querySelector<HTMLCanvasElement>("#viewport")!;
state.whyNoPicture = Viewport.problem(canvas);
const viewport = state.whyNoPicture === "" ? new Viewport(canvas, state, "target" in fragment.view) : null;
copy.target = viewport;

const isAimed = () => Boolean(viewport?.aimedAt) || "target" in fragment.view;
const hashWith = (isovalue: number | null) =>
  writeFragment({ room: room.roomKey, budgetMiB: fragment.budgetMiB, volume: state.linkVolume, isovalue, view: state.view }, isAimed());

async function savePng(): Promise<void> {
  const picture = await viewport?.png();
  if (!picture) return;
  const link = make("a", { href: URL.createObjectURL(picture), download: "palpate.png" });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

buildInterface(state, room, copy, {
  resetView(): void {
    state.view.follow = false;
    viewport?.resetView();
  },
  savePng: () => void savePng(),
  shareLink: () => new URL(hashWith(state.isovalue()), location.href).href,
});

let fragmentTimer = 0;
const writeAddress = () => {
  fragmentTimer ||= window.setTimeout(() => {
    fragmentTimer = 0;
    history.replaceState(null, "", hashWith(null));
  }, kFragmentMs);
};
state.on(["view", "link"], writeAddress); // after "link" the room's key may be another one
// A link to the same page with another room or view.
window.addEventListener("hashchange", () => location.reload());

if (fragment.room !== null) room.start({ room: fragment.room });
state.emit("view");

// For tests and scripts.
Object.assign(window, { palpate: { state, copy, room, viewport } });
