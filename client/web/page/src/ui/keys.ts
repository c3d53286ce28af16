// Keys of one letter, and those of the picture while it has the focus.
import type { State } from "../state";
import { find, make } from "./dom";

export interface Key {
  keys: string[]; // as KeyboardEvent.key, small letters
  shown: string;
  what: string;
  act(key: string): void;
}

const kTurnDeg = 5;
const kMostElevationDeg = 89;
const kZoom = 1.15;
const kTurns: Record<string, [number, number]> = {
  ArrowLeft: [-kTurnDeg, 0], ArrowRight: [kTurnDeg, 0], ArrowUp: [0, kTurnDeg], ArrowDown: [0, -kTurnDeg],
};

function turn(state: State, key: string): void {
  const { view } = state;
  view.azimuthDeg += kTurns[key][0];
  const elevation = view.elevationDeg + kTurns[key][1];
  view.elevationDeg = Math.max(-kMostElevationDeg, Math.min(kMostElevationDeg, elevation));
  state.emit("view");
}

function zoom(state: State, key: string): void {
  state.view.distanceMm *= key === "-" ? kZoom : 1 / kZoom;
  state.emit("view");
}

// Other controls that have letters or arrows of their own.
function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.closest("input, select, textarea, dialog") !== null;
}

export function listenToKeys(root: HTMLElement, state: State, letters: Key[]): void {
  const picture = find(root, "viewport");
  const pictureKeys: Key[] = [
    { keys: Object.keys(kTurns), shown: "← → ↑ ↓", what: "turn the focused picture", act: (k) => turn(state, k) },
    { keys: ["+", "=", "-"], shown: "+ −", what: "zoom the focused picture", act: (key) => zoom(state, key) },
  ];
  const isOn = find<HTMLInputElement>(root, "keys-on");
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    const pressed = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const keys = [...(event.target === picture ? pictureKeys : []), ...(isOn.checked ? letters : [])];
    const found = keys.find((key) => key.keys.includes(pressed));
    if (!found) return;
    event.preventDefault();
    found.act(pressed);
  });
  const rows = [...letters, ...pictureKeys].map(({ shown, what }) => {
    const keys = shown.split(" ").flatMap((key) => [make("kbd", {}, key), " "]);
    return make("tr", {}, make("th", { scope: "row" }, ...keys), make("td", {}, what));
  });
  find(root, "help-keys").append(...rows);
}
