// The patient's axes in a volume (client/view/scene/patient_axes.h). W is LPS: x to the patient's left, y to
// posterior, z to superior.
import { column, normalized } from "./geometry";
import type { AffineMap } from "./geometry";

export type Axis = 0 | 1 | 2;

// An axis of a frame, in its own direction or against it.
export interface SignedAxis {
  axis: Axis;
  sign: 1 | -1;
}

export interface FaceLetter extends SignedAxis {
  letter: string;
}

const kOrders: Axis[][] = [
  [0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0],
];
// A tie, as of a volume turned by 45°, must not depend on rounding.
const kTie = 1e-6;

export function opposite({ axis, sign }: SignedAxis): SignedAxis {
  return { axis, sign: sign > 0 ? -1 : 1 };
}

// The letter of a direction of W.
export function letterOf({ axis, sign }: SignedAxis): string {
  return (sign > 0 ? "LPS" : "RAI")[axis];
}

// The axes of the voxels along the x, y and z of W. Each axis of W gets the one that is nearest to it.
export function nearestAxes(worldFromIndex: AffineMap): SignedAxis[] {
  const directions = [0, 1, 2].map((axis) => normalized(column(worldFromIndex, axis)));
  let best = kOrders[0];
  let bestSum = 0;
  for (const order of kOrders) {
    const sum = order.reduce<number>((all, ofIndex, axis) => all + Math.abs(directions[ofIndex][axis]), 0);
    if (sum > bestSum + kTie) [best, bestSum] = [order, sum];
  }
  return best.map((axis, world) => ({ axis, sign: directions[axis][world] < 0 ? -1 : 1 }));
}

// The letters beside the faces: towards the last voxel or the first.
export function faceLetters(worldFromIndex: AffineMap): FaceLetter[] {
  return nearestAxes(worldFromIndex).flatMap((axis, world) => [
    { letter: "LPS"[world], ...axis },
    { letter: "RAI"[world], ...opposite(axis) },
  ]);
}
