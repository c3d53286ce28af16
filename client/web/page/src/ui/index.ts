// Everything of the page but the picture. index.html has the landmarks; each part here fills one.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import type { Room } from "../wire/room";
import { showBadge } from "./badge";
import { showControls } from "./controls";
import { find, setText } from "./dom";
import { showFacing } from "./facing";
import { showEvents, showHeader, tellSteering } from "./header";
import { showHistogram, toggleVeil } from "./histogram";
import { listenToKeys } from "./keys";
import { showLogin } from "./login";
import { showPlots } from "./plots";
import { showProgress } from "./progress";
import { showSlices } from "./slices";
import { nextTheme, showTheme } from "./theme";
import { showValues } from "./values";

export interface Actions {
  resetView(): void;
  savePng(): void;
  shareLink(): string;
}

const kMessageMs = 5000;

// Says something for a while in the line at the bottom.
function messenger(root: HTMLElement): (text: string) => void {
  const message = find(root, "message");
  let timer = 0;
  return (text) => {
    clearTimeout(timer);
    setText(message, text);
    timer = window.setTimeout(() => setText(message, ""), kMessageMs);
  };
}

// Where the browser gives no clipboard (plain http beyond this machine), a dialog shows the link.
async function share(root: HTMLElement, link: string, say: (text: string) => void): Promise<void> {
  const hasKey = /[#&]room=/.test(link);
  const note = hasKey ? "Who has the link can watch: it has the room's key." : "Others log in with a key of their own.";
  try {
    await navigator.clipboard.writeText(link);
    say(`Link copied. ${note}`);
  } catch {
    setText(find(root, "share-note"), note);
    const field = find<HTMLInputElement>(root, "share-link");
    field.value = link;
    find<HTMLDialogElement>(root, "share-dialog").showModal();
    field.select();
  }
}

function showPanelToggle(root: HTMLElement): void {
  const toggle = find(root, "panel-toggle");
  const panel = find(root, "panel");
  const show = (isShown: boolean) => {
    panel.hidden = !isShown;
    find(root, "main").classList.toggle("alone", !isShown);
    toggle.setAttribute("aria-expanded", String(isShown));
  };
  toggle.addEventListener("click", () => show(panel.hidden));
  find(root, "skip").addEventListener("click", (event) => {
    event.preventDefault(); // the fragment holds the room's key
    show(true);
    panel.focus();
  });
  // On a narrow screen the picture comes first. The width is that of style.css.
  show(!matchMedia("(max-width: 56rem)").matches);
}

function flip(state: State, member: "follow" | "slices"): void {
  state.view[member] = !state.view[member];
  state.emit("view");
}

function showLook(root: HTMLElement, state: State): void {
  const follow = find<HTMLInputElement>(root, "follow");
  const slices = find<HTMLInputElement>(root, "slices-shown");
  const ofPicture = [follow, find<HTMLButtonElement>(root, "reset"), find<HTMLButtonElement>(root, "png")];
  follow.addEventListener("change", () => flip(state, "follow"));
  slices.addEventListener("change", () => flip(state, "slices"));
  const update = () => {
    follow.checked = state.view.follow;
    const isFlat = state.whyNoPicture !== "";
    slices.checked = state.view.slices || isFlat;
    slices.disabled = isFlat;
    for (const control of ofPicture) control.disabled = isFlat;
  };
  state.on("view", update);
  state.on("picture", update);
  update();
}

export function buildInterface(root: HTMLElement, state: State, room: Room, copy: VolumeCopy, actions: Actions): void {
  const say = messenger(root);
  const help = find<HTMLDialogElement>(root, "help");
  const act = {
    reset: () => actions.resetView(),
    png: () => actions.savePng(),
    share: () => void share(root, actions.shareLink(), say),
    help: () => help.showModal(),
  };
  find(root, "reset").addEventListener("click", act.reset);
  find(root, "png").addEventListener("click", act.png);
  find(root, "share").addEventListener("click", act.share);
  find(root, "help-open").addEventListener("click", act.help);
  listenToKeys(root, state, [
    { keys: ["r"], shown: "R", what: "reset the view", act: act.reset },
    { keys: ["f"], shown: "F", what: "follow the stylus", act: () => flip(state, "follow") },
    { keys: ["v"], shown: "V", what: "veil", act: () => toggleVeil(state) },
    { keys: ["s"], shown: "S", what: "slices", act: () => flip(state, "slices") },
    { keys: ["t"], shown: "T", what: "theme: dark, light, as the system", act: () => nextTheme(state) },
    { keys: ["p"], shown: "P", what: "save the picture as PNG", act: act.png },
    { keys: ["?"], shown: "?", what: "this list", act: act.help },
  ]);
  showPanelToggle(root);
  showLook(root, state);
  showTheme(root, state);
  showHeader(root, state);
  showEvents(root, state);
  tellSteering(state);
  showProgress(root, state, copy);
  showHistogram(find(root, "isovalue"), state, room);
  showControls(root, state, room);
  showSlices(root, state, copy);
  showFacing(root, state, room);
  showLogin(root, state, room);
  const updates = [showBadge(root, state), showValues(root, state, copy), showPlots(root, state)];
  setInterval(() => updates.forEach((update) => update()), 200);
}
