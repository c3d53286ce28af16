// The overview's blocks, which stand for voxels until those come.
import type { Vec3 } from "../wire/messages";
import { kGroupEdge, kGroupVoxels, newVoxels } from "./manifest";
import type { VolumeShape, Voxels } from "./manifest";

interface Between {
  low: number;
  high: number;
  share: number; // of `high`
}

export class OverviewVoxels {
  // `blocks`: the voxels of the overview, (a, b, c) at (a * nb + b) * nc + c.
  constructor(readonly shape: VolumeShape, readonly blocks: Voxels) {}

  // Interpolated between the centres of blocks, at a voxel of the volume.
  at(i: number, j: number, k: number): number {
    const z = this.place(2, k);
    const line = new Float64Array(z.high - z.low + 1);
    this.takeLine(this.place(0, i), this.place(1, j), z.low, line);
    const value = line[0] * (1 - z.share) + line[line.length - 1] * z.share;
    return this.shape.type === "float32" ? value : Math.round(value);
  }

  // Group (a, b, c) of the volume of this shape.
  group(shape: VolumeShape, place: Vec3): Voxels {
    const group = newVoxels(shape.type, kGroupVoxels).fill(shape.background);
    const [x, y, z] = [0, 1, 2].map((axis) => {
      const first = kGroupEdge * place[axis];
      const count = Math.min(kGroupEdge, shape.size[axis] - first);
      return Array.from({ length: count }, (_, n) => this.place(axis, first + n));
    });
    const isWhole = shape.type !== "float32";
    const low = z[0].low;
    const line = new Float64Array(z[z.length - 1].high - low + 1); // of blocks, along the last axis
    for (let i = 0; i < x.length; ++i) {
      for (let j = 0; j < y.length; ++j) {
        this.takeLine(x[i], y[j], low, line);
        const at = (i << 10) | (j << 5);
        for (let k = 0; k < z.length; ++k) {
          const { low: a, high: b, share } = z[k];
          const value = line[a - low] * (1 - share) + line[b - low] * share;
          group[at | k] = isWhole ? Math.round(value) : value;
        }
      }
    }
    return group;
  }

  // Interpolates the blocks from `first` on along the last axis to a place on the others.
  private takeLine(x: Between, y: Between, first: number, line: Float64Array): void {
    const [, nj, nk] = this.shape.size;
    const start = (i: number, j: number) => (i * nj + j) * nk + first;
    const [ll, lh, hl, hh] = [start(x.low, y.low), start(x.low, y.high), start(x.high, y.low), start(x.high, y.high)];
    for (let n = 0; n < line.length; ++n) {
      const low = this.blocks[ll + n] * (1 - y.share) + this.blocks[lh + n] * y.share;
      const high = this.blocks[hl + n] * (1 - y.share) + this.blocks[hh + n] * y.share;
      line[n] = low * (1 - x.share) + high * x.share;
    }
  }

  private place(axis: number, voxel: number): Between {
    const { size, factor } = this.shape;
    const last = size[axis] - 1;
    const at = Math.min(Math.max((voxel - (factor - 1) / 2) / factor, 0), last);
    const low = Math.floor(at);
    return { low, high: Math.min(low + 1, last), share: at - low };
  }
}
