// Keys of one letter, and those of the picture while it has the focus.
import type { State } from "../state";
import { changeCamera, lookFromKey } from "../view/look";
import { find, make } from "./dom";

export interface Key {
  keys: string[]; // as KeyboardEvent.key, small letters
  shown: string;
  what: string;
  act(key: string): void;
}

const kTurnDeg = 5;
const kPanPx = 40;
const kZoom = 1.15;
const kSteps: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};

// Other controls that have letters or arrows of their own.
function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.closest("input:not([type=range], [type=checkbox]), select, dialog") !== null;
}

export function listenToKeys(state: State, letters: Key[]): void {
  const picture = find("viewport");
  const turn = (key: string) => {
    const [right, up] = kSteps[key];
    changeCamera(state, (camera) => camera.orbit(kTurnDeg * right, kTurnDeg * up));
  };
  const pan = (key: string) => {
    const [right, up] = kSteps[key.replace("Shift+", "")];
    state.view.follow = false;
    changeCamera(state, (camera) => camera.pan(-kPanPx * right, kPanPx * up, [picture.clientWidth, picture.clientHeight]));
  };
  const zoom = (key: string) => changeCamera(state, (camera) => camera.zoom(key === "-" ? 1 / kZoom : kZoom));
  const allLetters: Key[] = [...letters, {
    keys: ["1", "2", "3", "4", "5", "6"], shown: "1 … 6", what: "from anterior, posterior, left, right, superior, inferior",
    act: (key) => lookFromKey(state, Number(key)),
  }];
  const arrows = Object.keys(kSteps);
  const pictureKeys: Key[] = [
    { keys: arrows, shown: "← → ↑ ↓", what: "turn the focused picture", act: turn },
    { keys: arrows.map((key) => `Shift+${key}`), shown: "Shift+arrow", what: "move the focused picture", act: pan },
    { keys: ["+", "=", "-"], shown: "+ −", what: "zoom the focused picture", act: zoom },
  ];
  const isOn = find<HTMLInputElement>("keys-on");
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    const shift = event.shiftKey && event.key in kSteps ? "Shift+" : "";
    const pressed = event.key.length === 1 ? event.key.toLowerCase() : shift + event.key;
    const keys = [...(event.target === picture ? pictureKeys : []), ...(isOn.checked ? allLetters : [])];
    const found = keys.find((key) => key.keys.includes(pressed));
    if (!found) return;
    event.preventDefault();
    found.act(pressed);
  });
  const rows = [...allLetters, ...pictureKeys].map(({ shown, what }) => {
    const keys = shown.split(" ").flatMap((key) => [make("kbd", {}, key), " "]);
    return make("tr", {}, make("th", { scope: "row" }, ...keys), make("td", {}, what));
  });
  find("help-keys").append(...rows);
}
