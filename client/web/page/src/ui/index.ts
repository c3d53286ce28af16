// Everything of the page but the picture. index.html has the landmarks; each part here fills one.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import type { Room } from "../wire/room";
import { showBadge } from "./badge";
import { showControls } from "./controls";
import { find, setText } from "./dom";
import { showEvents, showHeader } from "./header";
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
  const note = /[#&]room=/.test(link) ? "It has the room's key: who has the link can watch." : "It has no key: others log in with their own.";
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
  // On a narrow screen the picture comes first. The width is that of style.css.
  show(!matchMedia("(max-width: 56rem)").matches);
}

function flip(state: State, member: "follow" | "slices"): void {
  state.view[member] = !state.view[member];
  state.emit("view");
}

function showLook(root: HTMLElement, state: State): void {
  const boxes = { follow: find<HTMLInputElement>(root, "follow"), slices: find<HTMLInputElement>(root, "slices-shown") };
  for (const member of ["follow", "slices"] as const) {
    boxes[member].addEventListener("change", () => flip(state, member));
  }
  const update = () => {
    boxes.follow.checked = state.view.follow;
    boxes.slices.checked = state.view.slices || state.whyNoPicture !== "";
    boxes.slices.disabled = state.whyNoPicture !== "";
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
  showProgress(root, state, copy);
  showHistogram(find(root, "isovalue"), state, room);
  showControls(root, state, room);
  showSlices(root, state, copy);
  showLogin(root, state, room);
  const updates = [showBadge(root, state), showValues(root, state), showPlots(root, state)];
  setInterval(() => updates.forEach((update) => update()), 200);
}
