// Matrices of 4 × 4: 16 numbers, column by column, as WebGL and three.js have them.
import type { AffineMap } from "../view/geometry";

export function multiply(a: Float64Array, b: Float64Array): Float64Array {
  const product = new Float64Array(16);
  for (let n = 0; n < 16; ++n) {
    for (let k = 0; k < 4; ++k) product[n] += a[(n % 4) + 4 * k] * b[k + (n & 12)];
  }
  return product;
}

// By elimination with the largest pivot.
export function inverse(matrix: Float64Array): Float64Array {
  // Each row of the matrix, and of the unit matrix behind it.
  const rows = [0, 1, 2, 3].map((r) =>
    [0, 1, 2, 3, 4, 5, 6, 7].map((c) => (c < 4 ? matrix[4 * c + r] : c - 4 === r ? 1 : 0)),
  );
  for (let n = 0; n < 4; ++n) {
    const size = (r: number) => Math.abs(rows[r][n]);
    const pivot = [0, 1, 2, 3].slice(n).reduce((a, b) => (size(b) > size(a) ? b : a));
    [rows[n], rows[pivot]] = [rows[pivot], rows[n]];
    rows[n] = rows[n].map((value) => value / rows[n][n]);
    for (let r = 0; r < 4; ++r) {
      const share = rows[r][n];
      if (r !== n) rows[r] = rows[r].map((value, c) => value - share * rows[n][c]);
    }
  }
  return Float64Array.from({ length: 16 }, (_, n) => rows[n % 4][4 + (n >> 2)]);
}

export function fromAffine(map: AffineMap): Float64Array {
  return Float64Array.from({ length: 16 }, (_, n) => (n % 4 < 3 ? map[4 * (n % 4) + (n >> 2)] : n === 15 ? 1 : 0));
}

export const row = (matrix: Float64Array, n: number): number[] => [0, 4, 8, 12].map((c) => matrix[c + n]);
