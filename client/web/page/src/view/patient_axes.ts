// The patient's axes in a volume (client/view/scene/patient_axes.h): the letters beside its faces.
import type { Vec3 } from "../wire/messages";
import { column, normalized } from "./geometry";
import type { AffineMap } from "./geometry";

export interface FaceLetter {
  letter: string;
  axis: number; // of the voxels
  sign: 1 | -1; // towards the last voxel or the first
}

const kOrders: Vec3[] = [
  [0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0],
];
// A tie, as of a volume turned by 45°, must not depend on rounding.
const kTie = 1e-6;

// Each axis of LPS gets the axis of the voxels that is nearest to it.
export function faceLetters(worldFromIndex: AffineMap): FaceLetter[] {
  const directions = [0, 1, 2].map((axis) => normalized(column(worldFromIndex, axis)));
  let best = kOrders[0];
  let bestSum = 0;
  for (const order of kOrders) {
    const sum = order.reduce((all, ofIndex, axis) => all + Math.abs(directions[ofIndex][axis]), 0);
    if (sum > bestSum + kTie) [best, bestSum] = [order, sum];
  }
  return best.flatMap((axis, world) => {
    const sign = directions[axis][world] < 0 ? -1 : 1;
    return [
      { letter: "LPS"[world], axis, sign } as FaceLetter,
      { letter: "RAI"[world], axis, sign: -sign } as FaceLetter,
    ];
  });
}
