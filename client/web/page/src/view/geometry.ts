// Vectors and affine maps. A map is the 3×4 matrix of 12 numbers, row by row, as in the message `placement`.
import { Matrix4 } from "three";

import type { Vec3 } from "../wire/messages";

export type AffineMap = number[];

export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (s: number, a: Vec3): Vec3 => [s * a[0], s * a[1], s * a[2]];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const norm = (a: Vec3): number => Math.hypot(a[0], a[1], a[2]);
export const normalized = (a: Vec3): Vec3 => scale(1 / norm(a), a);
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

export const clamp = (x: number, low: number, high: number) => Math.min(Math.max(x, low), high);

export const column = (m: AffineMap, n: number): Vec3 => [m[n], m[4 + n], m[8 + n]];
export const row = (m: AffineMap, n: number): Vec3 => [m[4 * n], m[4 * n + 1], m[4 * n + 2]];
// The linear part alone.
export const turn = (m: AffineMap, p: Vec3): Vec3 => [dot(row(m, 0), p), dot(row(m, 1), p), dot(row(m, 2), p)];
export const apply = (m: AffineMap, p: Vec3): Vec3 => add(turn(m, p), column(m, 3));

export function fromColumns(x: Vec3, y: Vec3, z: Vec3, origin: Vec3): AffineMap {
  return [0, 1, 2].flatMap((n) => [x[n], y[n], z[n], origin[n]]);
}

export function inverse(m: AffineMap): AffineMap {
  const [x, y, z, origin] = [column(m, 0), column(m, 1), column(m, 2), column(m, 3)];
  const rows = [cross(y, z), cross(z, x), cross(x, y)].map((r) => scale(1 / dot(x, cross(y, z)), r));
  return rows.flatMap((r) => [...r, -dot(r, origin)]);
}

// First `b`, then `a`.
export function compose(a: AffineMap, b: AffineMap): AffineMap {
  const columns = [0, 1, 2].map((n) => turn(a, column(b, n)));
  return fromColumns(columns[0], columns[1], columns[2], apply(a, column(b, 3)));
}

export const matrixOf = (m: AffineMap): Matrix4 => new Matrix4().fromArray([...m, 0, 0, 0, 1]).transpose();

// From blocks of factor³ voxels to voxels: the centre of block 0 is that of voxels 0 to factor - 1.
export function indexFromBlocks(factor: number): AffineMap {
  const centre = (factor - 1) / 2;
  return [factor, 0, 0, centre, 0, factor, 0, centre, 0, 0, factor, centre];
}
