// Linear maps for the camera. An affine map is 12 numbers, the rows of a 3 x 4 matrix. A matrix of 4 x 4
// is 16 numbers, column by column, as WebGL and three.js have it.
import type { Vec3 } from "./types";

export function apply(map: ArrayLike<number>, p: Vec3): Vec3 {
  return [0, 4, 8].map(
    (r) => map[r]! * p[0] + map[r + 1]! * p[1] + map[r + 2]! * p[2] + map[r + 3]!,
  ) as Vec3;
}

// Of directions: without the translation.
export function turn(map: ArrayLike<number>, d: Vec3): Vec3 {
  return [0, 4, 8].map((r) => map[r]! * d[0] + map[r + 1]! * d[1] + map[r + 2]! * d[2]) as Vec3;
}

export function normalized(v: Vec3): Vec3 {
  const length = Math.hypot(...v);
  return [v[0] / length, v[1] / length, v[2] / length];
}

export function multiply4(a: ArrayLike<number>, b: ArrayLike<number>): Float64Array {
  const product = new Float64Array(16);
  for (let n = 0; n < 16; ++n) {
    for (let k = 0; k < 4; ++k) product[n]! += a[(n % 4) + 4 * k]! * b[k + (n & 12)]!;
  }
  return product;
}

// By elimination with the largest pivot.
export function invert4(matrix: ArrayLike<number>): Float64Array {
  const columns = [0, 1, 2, 3].map((c) => [0, 1, 2, 3].map((r) => matrix[4 * c + r]!));
  const inverse = [0, 1, 2, 3].map((c) => [0, 1, 2, 3].map((r) => (r === c ? 1 : 0)));
  for (let n = 0; n < 4; ++n) {
    let pivot = n;
    for (let c = n + 1; c < 4; ++c) {
      if (Math.abs(columns[c]![n]!) > Math.abs(columns[pivot]![n]!)) pivot = c;
    }
    for (const side of [columns, inverse]) [side[n], side[pivot]] = [side[pivot]!, side[n]!];
    const by = columns[n]![n]!;
    for (const side of [columns, inverse]) side[n] = side[n]!.map((value) => value / by);
    for (let c = 0; c < 4; ++c) {
      const share = columns[c]![n]!;
      if (c === n || share === 0) continue;
      for (const side of [columns, inverse]) {
        side[c] = side[c]!.map((value, r) => value - share * side[n]![r]!);
      }
    }
  }
  return Float64Array.from(inverse.flat());
}

export function affine4(map: ArrayLike<number>): Float64Array {
  const matrix = new Float64Array(16);
  for (let n = 0; n < 12; ++n) matrix[(n >> 2) + 4 * (n & 3)] = map[n]!;
  matrix[15] = 1;
  return matrix;
}

export function invertAffine(map: ArrayLike<number>): number[] {
  const inverse = invert4(affine4(map));
  return Array.from({ length: 12 }, (_, n) => inverse[(n >> 2) + 4 * (n & 3)]!);
}
