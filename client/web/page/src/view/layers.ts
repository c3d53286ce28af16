// The layers: surfaces that are felt one behind the other, in order from outside. They are everybody's.
import type { State } from "../state";
import { isFreeAbove } from "../wire/contract";
import type { Vec3 } from "../wire/messages";

export interface Layer {
  id: number;
  name: string;
  isovalue: number;
  color: Vec3; // 0 to 1, as on the screen
}

// By their ids, as in the viewer; told apart by eyes without one of the three cones, too (after Okabe and Ito).
const kColors: Vec3[] = [
  [0.9, 0.62, 0], [0.34, 0.71, 0.91], [0, 0.62, 0.45], [0.94, 0.89, 0.26],
  [0.35, 0.55, 0.95], [0.84, 0.37, 0], [0.8, 0.47, 0.65], [0.75, 0.75, 0.75],
];

export function layersOf(state: State): Layer[] {
  const told = state.settings?.settings.layers?.layer ?? [];
  return told.map(({ id, name, isovalue }) => ({ id, name, isovalue, color: kColors[(id - 1) % kColors.length] }));
}

// Material has higher values than the isovalue. Poses tell of layers from which side they are touched.
export function isMaterialAbove(state: State): boolean {
  return layersOf(state).length > 0 || !isFreeAbove(state.pose);
}

// The isovalues between which SCP_H is; infinite where there is no layer. Null: no layers, or no pose.
export function bandOf(state: State): [number, number] | null {
  const layers = layersOf(state);
  if (layers.length === 0 || !state.pose) return null;
  const passed = state.pose.layersPassed;
  return [layers[passed - 1]?.isovalue ?? -Infinity, layers[passed]?.isovalue ?? Infinity];
}

// "touches skin", "behind skin, before bone"; "": no layers.
export function whereInLayers(state: State): string {
  const layers = layersOf(state);
  const { pose } = state;
  if (layers.length === 0 || !pose) return "";
  const touched = layers.find(({ id }) => id === pose.contactLayer);
  if (touched) return `touches ${touched.name}`;
  const [last, next] = [layers[pose.layersPassed - 1], layers[pose.layersPassed]];
  return [last ? `behind ${last.name}` : "outside", next ? `before ${next.name}` : ""].filter(Boolean).join(", ");
}
