// The camera of the desktop viewer (client/view/scene/camera.h): it turns about the point that it looks at, and
// keeps the device or the patient upright.
//
// Frames: D device (mm); U what is upright (x right, y up, z to the front); V view (mm, x right, y up, z towards
// the viewer).
import { fromAffine, multiply } from "../render/matrix";
import type { Vec3 } from "../wire/messages";
import { add, apply, column, cross, dot, fromColumns, inverse, norm, normalized, scale, subtract, turn } from "./geometry";
import type { AffineMap } from "./geometry";

export const kFieldOfViewDeg = 35; // of the picture's shorter side
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

const radians = (degrees: number) => (degrees * Math.PI) / 180;
const clamp = (x: number, low: number, high: number) => Math.min(Math.max(x, low), high);

function cornersOf(bounds: Bounds): Vec3[] {
  return [0, 1, 2, 3, 4, 5, 6, 7].map(
    (n) => [0, 1, 2].map((axis) => ((n >> axis) & 1 ? bounds.max : bounds.min)[axis]) as Vec3,
  );
}

// The box in D around the lattice's points from `low` to `high` (voxels).
export function boundsIn(deviceFromIndex: AffineMap, low: Vec3, high: Vec3): Bounds {
  const corners = cornersOf({ min: low, max: high }).map((p) => apply(deviceFromIndex, p));
  const least = (pick: (...values: number[]) => number) =>
    [0, 1, 2].map((axis) => pick(...corners.map((p) => p[axis]))) as Vec3;
  return { min: least(Math.min), max: least(Math.max) };
}

// Half of the visible width and height at a distance of 1.
export function halfView(size: Size): [number, number] {
  const shorter = Math.tan(radians(kFieldOfViewDeg / 2));
  const aspect = Math.max(size[0], 1) / Math.max(size[1], 1);
  return [shorter * Math.max(aspect, 1), shorter * Math.max(1 / aspect, 1)];
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
    const middle = scale(0.5, add(bounds.min, bounds.max));
    const half = Math.tan(radians(kFieldOfViewDeg / 2));
    const [right, up, back] = this.axes();
    let distanceMm = 0;
    for (const corner of cornersOf(bounds)) {
      const p = subtract(corner, middle);
      const aside = Math.max(Math.abs(dot(right, p)), Math.abs(dot(up, p)));
      distanceMm = Math.max(distanceMm, dot(back, p) + (kFitMargin * aside) / half);
    }
    this.set(middle, this.azimuthDeg, this.elevationDeg, distanceMm);
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

  viewFromD(): AffineMap {
    const [right, up, back] = this.axes();
    const eye = this.eye();
    return [...right, -dot(right, eye), ...up, -dot(up, eye), ...back, -dot(back, eye)];
  }

  // OpenGL clip coordinates, 4×4 column by column. Nothing near `bounds` and the target is cut.
  clipFromView(size: Size, bounds: Bounds): Float64Array {
    const [across, up] = halfView(size);
    const [near, far] = this.depths(bounds);
    const clip = new Float64Array(16);
    clip[0] = 1 / across;
    clip[5] = 1 / up;
    clip[10] = -(far + near) / (far - near);
    clip[14] = (-2 * far * near) / (far - near);
    clip[11] = -1;
    return clip;
  }

  clipFromD(size: Size, bounds: Bounds): Float64Array {
    return multiply(this.clipFromView(size, bounds), fromAffine(this.viewFromD()));
  }

  private back(): Vec3 {
    const [a, e] = [radians(this.azimuthDeg), radians(this.elevationDeg)];
    return turn(this.upright, [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)]);
  }

  // Distances along the view.
  private depths(bounds: Bounds): [number, number] {
    const view = this.viewFromD();
    const depths = cornersOf(bounds).map((p) => -apply(view, p)[2]);
    const nearest = Math.min(this.distanceMm, ...depths);
    const farthest = Math.max(this.distanceMm, ...depths);
    // Room for objects that stick out: a stylus, an arrow.
    const margin = 0.5 * norm(subtract(bounds.max, bounds.min)) + 0.1 * this.distanceMm;
    return [Math.max(nearest - margin, kNearShare * this.distanceMm), farthest + margin];
  }
}

// The frame U for which superior is up and anterior is in front. The volume's map `patientFromIndex` leads to P.
export function uprightPatient(deviceFromIndex: AffineMap, patientFromIndex: AffineMap): AffineMap {
  const indexFromPatient = inverse(patientFromIndex);
  const inD = (axis: number) => normalized(turn(deviceFromIndex, column(indexFromPatient, axis)));
  const [x, y] = [inD(0), inD(2)];
  return fromColumns(x, y, cross(x, y), [0, 0, 0]);
}
