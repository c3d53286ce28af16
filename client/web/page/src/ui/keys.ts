// Keys of one letter, and those of the picture while it has the focus.
import type { State } from "../state";
import { Camera, uprightPatient } from "../view/camera";
import { patientFrame } from "../view/patient_axes";
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

// Where the keys 1 to 6 look from, as the desktop viewer's: azimuth and elevation in degrees. From above and from
// below, anterior is up.
const kSides: [number, number][] = [[0, 0], [180, 0], [90, 0], [-90, 0], [180, 90], [0, -90]];

// Moves the camera of the view as src/view/viewport.ts would.
function move(state: State, change: (camera: Camera) => void): void {
  const { volume, placement, view } = state;
  const camera = new Camera();
  const frame = patientFrame(volume, placement);
  if (placement && frame?.isKnown) camera.upright = uprightPatient(placement.device_from_index, frame.fromIndex);
  camera.set(view.target, view.azimuthDeg, view.elevationDeg, view.distanceMm);
  change(camera);
  const { target, azimuthDeg, elevationDeg, distanceMm } = camera;
  Object.assign(view, { target, azimuthDeg, elevationDeg, distanceMm });
  state.emit("view");
}

// Other controls that have letters or arrows of their own.
function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.closest("input, select, textarea, dialog") !== null;
}

export function listenToKeys(root: HTMLElement, state: State, letters: Key[]): void {
  const picture = find(root, "viewport");
  const turn = (key: string) => {
    const [right, up] = kSteps[key];
    move(state, (camera) => camera.orbit(kTurnDeg * right, kTurnDeg * up));
  };
  const pan = (key: string) => {
    const [right, up] = kSteps[key.replace("Shift+", "")];
    state.view.follow = false;
    move(state, (camera) => camera.pan(-kPanPx * right, kPanPx * up, [picture.clientWidth, picture.clientHeight]));
  };
  const zoom = (key: string) => move(state, (camera) => camera.zoom(key === "-" ? 1 / kZoom : kZoom));
  const look = (key: string) => {
    state.view.follow = false;
    move(state, (camera) => camera.set(camera.target, ...kSides[Number(key) - 1], camera.distanceMm));
  };
  const sides: Key = {
    keys: ["1", "2", "3", "4", "5", "6"], shown: "1 … 6", what: "from anterior, posterior, left, right, superior, inferior", act: look,
  };
  const arrows = Object.keys(kSteps);
  const pictureKeys: Key[] = [
    { keys: arrows, shown: "← → ↑ ↓", what: "turn the focused picture", act: turn },
    { keys: arrows.map((key) => `Shift+${key}`), shown: "Shift+arrow", what: "move the focused picture", act: pan },
    { keys: ["+", "=", "-"], shown: "+ −", what: "zoom the focused picture", act: zoom },
  ];
  const isOn = find<HTMLInputElement>(root, "keys-on");
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target)) return;
    const shift = event.shiftKey && event.key in kSteps ? "Shift+" : "";
    const pressed = event.key.length === 1 ? event.key.toLowerCase() : shift + event.key;
    const keys = [...(event.target === picture ? pictureKeys : []), ...(isOn.checked ? [...letters, sides] : [])];
    const found = keys.find((key) => key.keys.includes(pressed));
    if (!found) return;
    event.preventDefault();
    found.act(pressed);
  });
  const rows = [...letters, sides, ...pictureKeys].map(({ shown, what }) => {
    const keys = shown.split(" ").flatMap((key) => [make("kbd", {}, key), " "]);
    return make("tr", {}, make("th", { scope: "row" }, ...keys), make("td", {}, what));
  });
  find(root, "help-keys").append(...rows);
}
