// Rays through a trilinear volume in double precision, in another way than the shader: all planes that a ray
// crosses are sorted, and within a cell the cubic through four samples is searched for its first root.

export const arrays = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, float32: Float32Array };

// Numbers from 0 to 1 that only depend on the seed.
export function randomNumbers(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), state | 1);
    t = (t + Math.imul(t ^ (t >>> 7), t | 61)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
}

export class Volume {
  // value(i, j, k) is rounded to the type.
  constructor(shape, value) {
    this.shape = shape;
    const [ni, nj, nk] = shape.size;
    this.voxels = new arrays[shape.type](ni * nj * nk);
    for (let n = 0; n < this.voxels.length; ++n) {
      const found = value(Math.floor(n / (nj * nk)), Math.floor(n / nk) % nj, n % nk);
      this.voxels[n] = shape.type === "float32" ? found : Math.round(found);
    }
  }

  at(i, j, k) {
    const [ni, nj, nk] = this.shape.size;
    const isInside = i >= 0 && j >= 0 && k >= 0 && i < ni && j < nj && k < nk;
    return isInside ? this.voxels[(i * nj + j) * nk + k] : this.shape.background;
  }

  set(i, j, k, value) {
    const [, nj, nk] = this.shape.size;
    this.voxels[(i * nj + j) * nk + k] = value;
  }

  // Voxels beyond the lattice are background.
  group(a, b, c) {
    const voxels = new arrays[this.shape.type](32 ** 3);
    for (let n = 0; n < voxels.length; ++n) {
      voxels[n] = this.at(32 * a + (n >> 10), 32 * b + ((n >> 5) & 31), 32 * c + (n & 31));
    }
    return { place: [a, b, c], voxels };
  }

  groups() {
    const [na, nb, nc] = this.shape.size.map((size) => Math.ceil(size / 32));
    return Array.from({ length: na * nb * nc }, (_, n) =>
      this.group(Math.floor(n / (nb * nc)), Math.floor(n / nc) % nb, n % nc),
    );
  }

  // Trilinear within the cell whose first voxel is `cell`.
  within(cell, p) {
    let sum = 0;
    for (let corner = 0; corner < 8; ++corner) {
      let weight = 1;
      const at = cell.map((c, axis) => {
        const upper = (corner >> axis) & 1;
        weight *= upper ? p[axis] - c : 1 - (p[axis] - c);
        return c + upper;
      });
      sum += weight * this.at(...at);
    }
    return sum;
  }
}

const along = (origin, direction, t) => origin.map((o, axis) => o + t * direction[axis]);

// The part of a ray within the padded lattice, from voxel -1 to voxel `size`, not behind the origin.
function partInside(size, origin, direction) {
  let [from, to] = [0, Infinity];
  for (let axis = 0; axis < 3; ++axis) {
    const ends = [(-1 - origin[axis]) / direction[axis], (size[axis] - origin[axis]) / direction[axis]];
    if (direction[axis] === 0) {
      if (origin[axis] < -1 || origin[axis] > size[axis]) return null;
      continue;
    }
    from = Math.max(from, Math.min(...ends));
    to = Math.min(to, Math.max(...ends));
  }
  return from < to ? [from, to] : null;
}

function planesBetween(origin, direction, from, to) {
  const crossings = [from, to];
  for (let axis = 0; axis < 3; ++axis) {
    if (direction[axis] === 0) continue;
    const ends = [from, to].map((t) => origin[axis] + t * direction[axis]);
    for (let n = Math.ceil(Math.min(...ends)); n <= Math.max(...ends); ++n) {
      const t = (n - origin[axis]) / direction[axis];
      if (t > from && t < to) crossings.push(t);
    }
  }
  return crossings.sort((a, b) => a - b);
}

// Where the cubic with these values at 0, 1/3, 2/3 and 1 turns, within (0, 1), ascending.
function turnsOf([f0, f1, f2, f3]) {
  const c = (-11 * f0 + 18 * f1 - 9 * f2 + 2 * f3) / 2;
  const b = (9 * (2 * f0 - 5 * f1 + 4 * f2 - f3)) / 2;
  const a = (9 * (-f0 + 3 * f1 - 3 * f2 + f3)) / 2;
  // 3 a s² + 2 b s + c
  const discriminant = b * b - 3 * a * c;
  if (!(discriminant > 0)) return [];
  const q = -(b + Math.sign(b || 1) * Math.sqrt(discriminant));
  return [q / (3 * a), c / q].filter((s) => s > 0 && s < 1).sort((x, y) => x - y);
}

// The first distance at which the ray changes its side of the isovalue; Infinity if it never does. Distances are
// in units of `direction`, everything in voxels.
export function firstHit(volume, origin, direction, isovalue) {
  const { size, background } = volume.shape;
  const part = partInside(size, origin, direction);
  if (!part) return Infinity;
  const starts = part[0] > 0; // from outside
  let above = starts ? background > isovalue : null;
  const planes = planesBetween(origin, direction, ...part);
  for (let n = 0; n + 1 < planes.length; ++n) {
    const [t0, t1] = [planes[n], planes[n + 1]];
    const cell = along(origin, direction, (t0 + t1) / 2).map(Math.floor);
    const at = (s) => volume.within(cell, along(origin, direction, t0 + s * (t1 - t0))) - isovalue;
    above ??= at(0) > 0;
    const ends = [0, ...turnsOf([0, 1 / 3, 2 / 3, 1].map(at)), 1];
    if (at(0) > 0 !== above) return t0;
    for (let m = 0; m + 1 < ends.length; ++m) {
      if (at(ends[m + 1]) > 0 === above) continue;
      let [low, high] = [ends[m], ends[m + 1]];
      for (let k = 0; k < 60; ++k) {
        const middle = (low + high) / 2;
        if (at(middle) > 0 === above) low = middle;
        else high = middle;
      }
      return t0 + high * (t1 - t0);
    }
  }
  return background > isovalue !== above ? part[1] : Infinity;
}
