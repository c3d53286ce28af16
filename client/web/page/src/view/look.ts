// What the view's angles mean for the volume that is shown: which way is up, and how to look from its sides.
//
// Frames: D, U, V of camera.ts; P of patient_axes.ts.
import type { State } from "../state";
import type { Placement, Volume } from "../wire/contract";
import type { Vec3 } from "../wire/messages";
import { Camera, uprightPatient } from "./camera";
import { column, compose, cross, dot, fromColumns, inverse, normalized, scale } from "./geometry";
import type { AffineMap } from "./geometry";
import { nearestAxes, patientFrame } from "./patient_axes";

export interface Sides {
  deviceFromPatient: AffineMap; // or from the world, as patientFrame
  ofPatient: boolean;
  upright: AffineMap; // D from U
}

// Null: there is no volume, or it has no place.
export function sidesOf(volume: Volume | null, placement: Placement | null): Sides | null {
  const frame = patientFrame(volume, placement);
  if (!frame || !placement) return null;
  const deviceFromPatient = compose(placement.deviceFromIndex, inverse(frame.fromIndex));
  if (frame.isKnown) {
    return { deviceFromPatient, ofPatient: true, upright: uprightPatient(placement.deviceFromIndex, frame.fromIndex) };
  }
  // The axes of D that are nearest to the world's.
  const nearest = nearestAxes(deviceFromPatient);
  const [x, y] = [0, 1].map((n) => scale(nearest[n].sign, normalized(column(deviceFromPatient, nearest[n].axis))));
  return { deviceFromPatient, ofPatient: false, upright: fromColumns(x, y, cross(x, y), [0, 0, 0]) };
}

export function cameraOf({ volume, placement, view }: State): Camera {
  const camera = new Camera();
  camera.upright = sidesOf(volume, placement)?.upright ?? camera.upright;
  camera.set(view.target, view.azimuthDeg, view.elevationDeg, view.distanceMm);
  return camera;
}

export function changeCamera(state: State, change: (camera: Camera) => void): void {
  const camera = cameraOf(state);
  change(camera);
  const { target, azimuthDeg, elevationDeg, distanceMm } = camera;
  state.setView({ target, azimuthDeg, elevationDeg, distanceMm });
}

// Looks along the axis of U that is nearest to `fromD`, a direction of D. From above, a patient's anterior is up.
export function lookFrom(state: State, fromD: Vec3): void {
  const sides = sidesOf(state.volume, state.placement);
  if (!sides) return;
  const from = [0, 1, 2].map((axis) => dot(column(sides.upright, axis), fromD));
  const axis = from.map(Math.abs).indexOf(Math.max(...from.map(Math.abs)));
  const isPositive = from[axis] > 0;
  const angles: [number, number][] = [
    [isPositive ? 90 : -90, 0],
    [isPositive && sides.ofPatient ? 180 : 0, isPositive ? 90 : -90],
    [isPositive ? 0 : 180, 0],
  ];
  state.view.follow = false;
  changeCamera(state, (camera) => camera.set(camera.target, ...angles[axis], camera.distanceMm));
}

// The keys 1 to 6: anterior, posterior, left, right, superior and inferior of a patient; otherwise front, back, left,
// right, top and bottom as they are seen. A patient's left is at the viewer's right.
export function lookFromKey(state: State, key: number): void {
  const sides = sidesOf(state.volume, state.placement);
  if (!sides) return;
  const left = sides.ofPatient ? 1 : -1;
  const [axis, sign] = [[2, 1], [2, -1], [0, left], [0, -left], [1, 1], [1, -1]][key - 1];
  lookFrom(state, scale(sign, column(sides.upright, axis)));
}
