// The camera of the desktop viewer (client/view/drawing/camera.h): it turns about the point that it looks at, and
// keeps the device or the patient upright.
//
// Frames: D device (mm); U what is upright (x right, y up, z to the front); V view (mm, x right, y up, z towards
// the viewer).
import { Matrix4 } from "three";

import type { Vec3 } from "../wire/messages";
import { add, apply, clamp, column, cross, dot, fromColumns, inverse, matrixOf, norm, normalized, row, scale, subtract, turn } from "./geometry";
import type { AffineMap } from "./geometry";

const kHalfView = Math.tan((17.5 * Math.PI) / 180); // of the picture's shorter side, at a distance of 1
const kMaxElevationDeg = 89;
const kMinDistanceMm = 1e-3;
const kMaxDistanceMm = 1e6;
const kFitMargin = 1.05; // room for the letters
// The nearest visible distance, as a share of the distance to the target.
const kNearShare = 0.01;

export type Size = [number, number]; // pixels

export interface Bounds {
  min: Vec3;
  max: Vec3;
}

const middleOf = ({ min, max }: Bounds) => scale(0.5, add(min, max));

// How far a box reaches from its middle along a direction, times the direction's length.
function reach({ min, max }: Bounds, direction: Vec3): number {
  return dot(scale(0.5, subtract(max, min)), direction.map(Math.abs) as Vec3);
}

// The box in D around the lattice's points from `min` to `max` (voxels).
export function boundsIn(deviceFromIndex: AffineMap, min: Vec3, max: Vec3): Bounds {
  const middle = apply(deviceFromIndex, middleOf({ min, max }));
  const half = [0, 1, 2].map((axis) => reach({ min, max }, row(deviceFromIndex, axis))) as Vec3;
  return { min: subtract(middle, half), max: add(middle, half) };
}

// Half of the visible width and height at a distance of 1.
export function halfView(size: Size): [number, number] {
  const aspect = Math.max(size[0], 1) / Math.max(size[1], 1);
  return [kHalfView * Math.max(aspect, 1), kHalfView * Math.max(1 / aspect, 1)];
}

export class Camera {
  target: Vec3 = [0, 0, 0];
  azimuthDeg = 30; // about U's y, 0 from +z
  elevationDeg = 20; // above U's x-z plane
  distanceMm = 300;
  // A rotation. The angles stay when it changes, so the view turns.
  upright: AffineMap = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]; // D from U

  set(target: Vec3, azimuthDeg: number, elevationDeg: number, distanceMm: number): void {
    this.target = target;
    this.azimuthDeg = azimuthDeg - 360 * Math.round(azimuthDeg / 360);
    this.elevationDeg = clamp(elevationDeg, -kMaxElevationDeg, kMaxElevationDeg);
    this.distanceMm = clamp(distanceMm, kMinDistanceMm, kMaxDistanceMm);
  }

  orbit(azimuthDeg: number, elevationDeg: number): void {
    this.set(this.target, this.azimuthDeg + azimuthDeg, this.elevationDeg + elevationDeg, this.distanceMm);
  }

  // A factor above 1 moves closer.
  zoom(factor: number): void {
    if (factor > 0) this.set(this.target, this.azimuthDeg, this.elevationDeg, this.distanceMm / factor);
  }

  // Moves the target by a drag of this many pixels.
  pan(rightPx: number, downPx: number, size: Size): void {
    const mmPerPx = (2 * this.distanceMm * halfView(size)[1]) / Math.max(size[1], 1);
    const [right, up] = this.axes();
    this.target = add(this.target, add(scale(-rightPx * mmPerPx, right), scale(downPx * mmPerPx, up)));
  }

  // Sees all of `bounds` from its direction, from as near as possible, in a picture of any shape.
  fit(bounds: Bounds): void {
    const [right, up, back] = this.axes();
    // A point at p from the middle is seen from a distance of back · p + kFitMargin |side · p| / kHalfView.
    const sides = [right, up].flatMap((side) => [1, -1].map((sign) => scale((sign * kFitMargin) / kHalfView, side)));
    const distances = sides.map((side) => reach(bounds, add(back, side)));
    this.set(middleOf(bounds), this.azimuthDeg, this.elevationDeg, Math.max(...distances));
  }

  // The axes of V in D: right, up, and towards the viewer.
  axes(): [Vec3, Vec3, Vec3] {
    const back = normalized(this.back());
    const right = normalized(cross(column(this.upright, 1), back));
    return [right, cross(back, right), back];
  }

  eye(): Vec3 {
    return add(this.target, scale(this.distanceMm, this.back()));
  }

  // OpenGL clip coordinates, 4×4 column by column. Nothing near `bounds` and the target is cut.
  clipFromD(size: Size, bounds: Bounds): number[] {
    const [right, up, back] = this.axes();
    const eye = this.eye();
    const middleMm = dot(back, subtract(eye, middleOf(bounds)));
    const reachMm = reach(bounds, back);
    // Room for objects that stick out: a stylus, an arrow.
    const marginMm = 0.5 * norm(subtract(bounds.max, bounds.min)) + 0.1 * this.distanceMm;
    const near = Math.max(Math.min(this.distanceMm, middleMm - reachMm) - marginMm, kNearShare * this.distanceMm);
    const far = Math.max(this.distanceMm, middleMm + reachMm) + marginMm;
    const [x, y] = halfView(size).map((half) => half * near);
    const viewFromD = matrixOf([right, up, back].flatMap((axis) => [...axis, -dot(axis, eye)]));
    return new Matrix4().makePerspective(-x, x, y, -y, near, far).multiply(viewFromD).elements;
  }

  private back(): Vec3 {
    const [a, e] = [this.azimuthDeg, this.elevationDeg].map((degrees) => (degrees * Math.PI) / 180);
    return turn(this.upright, [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)]);
  }
}

// The frame U for which superior is up and anterior is in front. The volume's map `patientFromIndex` leads to P.
export function uprightPatient(deviceFromIndex: AffineMap, patientFromIndex: AffineMap): AffineMap {
  const indexFromPatient = inverse(patientFromIndex);
  const inD = (axis: number) => normalized(turn(deviceFromIndex, column(indexFromPatient, axis)));
  const [x, y] = [inD(0), inD(2)];
  return fromColumns(x, y, cross(x, y), [0, 0, 0]);
}
