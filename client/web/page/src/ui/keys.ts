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
const kZoom = 1.15;

function turn(state: State, key: string): void {
  const { view } = state;
  if (key === "ArrowLeft") view.azimuthDeg -= kTurnDeg;
  if (key === "ArrowRight") view.azimuthDeg += kTurnDeg;
  if (key === "ArrowUp") view.elevationDeg = Math.min(89, view.elevationDeg + kTurnDeg);
  if (key === "ArrowDown") view.elevationDeg = Math.max(-89, view.elevationDeg - kTurnDeg);
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
    { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"], shown: "← → ↑ ↓", what: "turn, while the picture has the focus", act: (key) => turn(state, key) },
    { keys: ["+", "=", "-"], shown: "+ −", what: "zoom, while the picture has the focus", act: (key) => zoom(state, key) },
  ];
  const isOn = find<HTMLInputElement>(root, "keys-on");
  const find_ = (keys: Key[], pressed: string) => keys.find((key) => key.keys.includes(pressed));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    const pressed = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const found =
      (event.target === picture ? find_(pictureKeys, pressed) : undefined) ?? (isOn.checked ? find_(letters, pressed) : undefined);
    if (!found) return;
    event.preventDefault();
    found.act(pressed);
  });
  const rows = [...letters, ...pictureKeys].map(({ shown, what }) =>
    make("tr", {}, make("th", { scope: "row" }, ...shown.split(" ").flatMap((key) => [make("kbd", {}, key), " "])), make("td", {}, what)),
  );
  find(root, "help-keys").append(...rows);
}
