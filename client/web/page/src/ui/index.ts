// Everything of the page but the picture. index.html has the landmarks; each part here fills one.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import type { Room } from "../wire/room";
import { showBadge } from "./badge";
import { showControls } from "./controls";
import { showCube } from "./cube";
import { find, setText } from "./dom";
import { showFacing } from "./facing";
import { nextTheme, showEvents, showHeader, showTheme, tellSteering } from "./header";
import { showHistogram, toggleVeil } from "./histogram";
import { listenToKeys } from "./keys";
import { showLogin } from "./login";
import { showPlots } from "./plots";
import { showProgress } from "./progress";
import { showSlices } from "./slices";
import { showStop } from "./stop";
import { showValues } from "./values";
import { valueText } from "./words";

export interface Actions {
  resetView(): void;
  savePng(): void;
  shareLink(): string;
}

const kMessageMs = 5000;

// Says something for a while in the line at the bottom.
function messenger(): (text: string) => void {
  const message = find("message");
  let timer = 0;
  return (text) => {
    clearTimeout(timer);
    setText(message, text);
    timer = window.setTimeout(() => setText(message, ""), kMessageMs);
  };
}

// Where the browser gives no clipboard (plain http beyond this machine), it asks to copy by hand.
async function share(link: string, say: (text: string) => void): Promise<void> {
  const hasKey = /[#&]room=/.test(link);
  const note = hasKey ? "Who has the link can watch: it has the room's key." : "Others log in with a key of their own.";
  try {
    await navigator.clipboard.writeText(link);
    say(`Link copied. ${note}`);
  } catch {
    prompt(note, link);
  }
}

// A link shows the surface that its maker saw. The isovalue is everybody's, so the veil shows it. What is of a
// volume is forgotten when another one comes.
function keepLink(state: State, say: (text: string) => void): void {
  const keep = () => {
    const { volume } = state;
    if (volume && volume.name !== state.linkVolume) {
      if (state.linkVolume !== null) state.view.cross = state.linkIsovalue = null;
      state.linkVolume = volume.name;
    }
    const [was, is] = [state.linkIsovalue, state.isovalue()];
    if (was === null || is === null || !volume) return;
    state.linkIsovalue = null;
    if (Math.abs(was - is) <= 1e-5 * Math.abs(was)) return; // the link's digits
    const veil = state.view.veil === null ? ` The veil shows ${valueText(was)}.` : "";
    const text = `The link was made at isovalue ${valueText(was, volume.unit)}. It is ${valueText(is, volume.unit)} now.${veil}`;
    say(text);
    state.tell(text);
    state.setView({ veil: state.view.veil ?? was });
  };
  state.on(["volume", "settings", "pose"], keep);
}

function showPanelToggle(): void {
  const toggle = find("panel-toggle");
  const panel = find("panel");
  const show = (isShown: boolean) => {
    panel.hidden = !isShown;
    find("main").classList.toggle("alone", !isShown);
    toggle.setAttribute("aria-expanded", String(isShown));
  };
  toggle.addEventListener("click", () => show(panel.hidden));
  find("skip").addEventListener("click", (event) => {
    event.preventDefault(); // the fragment holds the room's key
    show(true);
    panel.focus();
  });
  // On a narrow screen the picture comes first. The width is that of style.css.
  show(!matchMedia("(max-width: 56rem)").matches);
}

function showLook(state: State): void {
  const follow = find<HTMLInputElement>("follow");
  const slices = find<HTMLInputElement>("slices-shown");
  const ofPicture = [follow, find<HTMLButtonElement>("reset"), find<HTMLButtonElement>("png")];
  const update = () => {
    follow.checked = state.view.follow;
    const isFlat = state.whyNoPicture !== "";
    slices.checked = state.view.slices || isFlat;
    slices.disabled = isFlat;
    for (const control of ofPicture) control.disabled = isFlat;
  };
  state.watch(["view", "picture"], update);
}

export function buildInterface(state: State, room: Room, copy: VolumeCopy, actions: Actions): void {
  const say = messenger();
  const help = find<HTMLDialogElement>("help");
  // `id`: of the button or box that does the same.
  const letters: { key: string; what: string; id?: string; act(): void }[] = [
    { key: "r", what: "reset the view", id: "reset", act: () => actions.resetView() },
    { key: "f", what: "follow the stylus", id: "follow", act: () => state.setView({ follow: !state.view.follow }) },
    { key: "v", what: "veil", act: () => toggleVeil(state) },
    { key: "s", what: "slices", id: "slices-shown", act: () => state.setView({ slices: !state.view.slices }) },
    { key: "t", what: "theme: dark, light, as the system", id: "theme", act: () => nextTheme(state) },
    { key: "p", what: "save the picture as PNG", id: "png", act: () => actions.savePng() },
    { key: "?", what: "this list", id: "help-open", act: () => help.showModal() },
  ];
  for (const { id, act } of letters) if (id) find(id).addEventListener("click", act);
  listenToKeys(state, letters.map(({ key, what, act }) => ({ keys: [key], shown: key.toUpperCase(), what, act })));
  find("share").addEventListener("click", () => void share(actions.shareLink(), say));
  showPanelToggle();
  showLook(state);
  showCube(state);
  keepLink(state, say);
  showTheme(state);
  showHeader(state);
  showEvents(state);
  tellSteering(state);
  showHistogram(find("isovalue"), state, room);
  showControls(state, room);
  showStop(state, room);
  showSlices(state, copy);
  showFacing(state, room);
  showLogin(state, room);
  const updates = [showBadge(state), showProgress(state, copy), showValues(state, copy), showPlots(state)];
  setInterval(() => updates.forEach((update) => update()), 200);
}
