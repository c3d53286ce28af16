// A volume in groups of 32³ voxels. A group that is absent is background, or is taken from the overview.
import type { Vec3 } from "../wire/messages";
import { groupCounts, groupNumber, kGroupEdge, kGroupVoxels, newVoxels } from "./manifest";
import type { VolumeShape, Voxels } from "./manifest";
import type { OverviewVoxels } from "./overview_voxels";

// A slice: value (x, y) is at y * width + x. Across axis 0, x is j and y is k; across 1, i and k; across 2, i and j.
export interface Plane {
  width: number;
  height: number;
  values: Float32Array;
}

export class GroupedVolume {
  readonly counts: Vec3;
  readonly groups = new Map<number, Voxels>();
  // Groups that are on their way are shown as the overview has them.
  readonly awaited = new Set<number>();
  overview: OverviewVoxels | null = null;

  constructor(readonly shape: VolumeShape) {
    this.counts = groupCounts(shape.size);
  }

  // `dense`: voxel (i, j, k) at (i * nj + j) * nk + k.
  static fromDense(shape: VolumeShape, dense: Voxels): GroupedVolume {
    const volume = new GroupedVolume(shape);
    const [ni, nj, nk] = shape.size;
    const [na, nb, nc] = volume.counts;
    for (let number = 0; number < na * nb * nc; ++number) {
      volume.groups.set(number, newVoxels(shape.type, kGroupVoxels).fill(shape.background));
    }
    for (let i = 0; i < ni; ++i) {
      for (let j = 0; j < nj; ++j) {
        for (let c = 0; c < nc; ++c) {
          const number = groupNumber(volume.counts, i >> 5, j >> 5, c);
          const from = (i * nj + j) * nk + c * kGroupEdge;
          const rest = Math.min(kGroupEdge, nk - c * kGroupEdge);
          volume.groups.get(number)!.set(dense.subarray(from, from + rest), ((i & 31) << 10) | ((j & 31) << 5));
        }
      }
    }
    return volume;
  }

  // Background outside of the lattice.
  value(i: number, j: number, k: number): number {
    const { size, background } = this.shape;
    if (i < 0 || j < 0 || k < 0 || i >= size[0] || j >= size[1] || k >= size[2]) return background;
    const number = groupNumber(this.counts, i >> 5, j >> 5, k >> 5);
    const group = this.groups.get(number);
    if (group) return group[((i & 31) << 10) | ((j & 31) << 5) | (k & 31)];
    return this.overview && this.awaited.has(number) ? this.overview.at(i, j, k) : background;
  }

  plane(axis: 0 | 1 | 2, index: number): Plane {
    const [across, up] = [axis === 0 ? 1 : 0, axis === 2 ? 1 : 2];
    const [width, height] = [this.shape.size[across], this.shape.size[up]];
    const values = new Float32Array(width * height);
    const at: Vec3 = [index, index, index];
    for (let y = 0; y < height; ++y) {
      at[up] = y;
      for (let x = 0; x < width; ++x) {
        at[across] = x;
        values[y * width + x] = this.value(at[0], at[1], at[2]);
      }
    }
    return { width, height, values };
  }
}
