// Where the patient faces, of a file that states no orientation: one question beside the picture, which somebody
// who may steer "facing" answers once for everybody.
import type { State } from "../state";
import type { Room } from "../wire/room";
import { find, make, setText } from "./dom";

export const kFacingKey = "facing"; // client/sdk/placement.h
const kDirections = ["+x", "−x", "+y", "−y", "+z", "−z"];

// "": nothing to ask. Built-in shapes have no face.
function lineOf({ volume, placement }: State): string {
  if (!volume?.name || !placement) return "";
  if (placement.patientAxesAnswered) return "Sides as answered";
  return placement.patientAxes === "" && !volume.name.startsWith("builtin:") ? "Which way does it face?" : "";
}

export function showFacing(state: State, room: Room): void {
  const line = find("facing");
  const dialog = find<HTMLDialogElement>("facing-dialog");
  const [face, head] = ["facing-face", "facing-head"].map((id) => find<HTMLSelectElement>(id));
  const keep = find<HTMLButtonElement>("facing-keep");
  const error = find("facing-error");
  for (const select of [face, head]) {
    select.append(make("option", { value: "" }), ...kDirections.map((name, value) => make("option", { value }, name)));
    select.addEventListener("change", () => update());
  }
  const chosen = () => [face, head].map((select) => (select.value === "" ? -1 : Number(select.value)));
  const update = () => {
    const text = lineOf(state);
    line.hidden = text === "";
    setText(line, text);
    const may = state.hello?.may_steer.includes(kFacingKey) ?? false;
    find("facing-fields").hidden = !may;
    find("facing-may-not").hidden = may;
    const [f, h] = chosen();
    keep.disabled = state.settings?.replayed || f < 0 || h < 0 || f >> 1 === h >> 1;
  };
  line.addEventListener("click", () => {
    face.value = head.value = "";
    setText(error, "");
    update();
    dialog.showModal();
  });
  keep.addEventListener("click", (event) => {
    event.preventDefault();
    const [f, h] = chosen();
    room.steer(kFacingKey, kDirections.length * f + h).then(() => dialog.close(), (refusal: Error) => setText(error, refusal.message));
  });
  state.watch(["volume", "placement", "settings", "hello"], update);
  state.on("volume", () => dialog.close()); // it asked about the one before
}
