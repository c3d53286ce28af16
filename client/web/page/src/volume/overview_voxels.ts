// The overview's blocks, which stand for voxels until those come.
import type { Vec3, VolumeShape, VoxelType, Voxels } from "../render/types";
import { kGroupEdge, kGroupVoxels, newVoxels } from "./manifest";

interface Between {
  low: number;
  high: number;
  share: number; // of `high`
}

export class OverviewVoxels {
  // `blocks`: block (a, b, c) at (a * nb + b) * nc + c.
  constructor(
    readonly size: Vec3,
    readonly factor: number,
    readonly type: VoxelType,
    readonly blocks: Voxels,
  ) {}

  // Interpolated between the centres of blocks, at a voxel of the volume.
  at(i: number, j: number, k: number): number {
    const value = this.between(this.place(0, i), this.place(1, j), this.place(2, k));
    return this.type === "float32" ? value : Math.round(value);
  }

  // Group (a, b, c) of the volume of this shape.
  group(shape: VolumeShape, place: Vec3): Voxels {
    const group = newVoxels(shape.type, kGroupVoxels).fill(shape.background);
    const extent = [0, 1, 2].map((axis) => Math.min(kGroupEdge, shape.size[axis] - kGroupEdge * place[axis]));
    const places = [0, 1, 2].map((axis) =>
      Array.from({ length: extent[axis] }, (_, n) => this.place(axis, kGroupEdge * place[axis] + n)),
    );
    const half = shape.type === "float32" ? 0 : 0.5; // arrays of integers round down
    places[0].forEach((x, i) =>
      places[1].forEach((y, j) =>
        places[2].forEach((z, k) => {
          const value = this.between(x, y, z);
          group[(i << 10) | (j << 5) | k] = half ? Math.floor(value + half) : value;
        }),
      ),
    );
    return group;
  }

  private place(axis: number, voxel: number): Between {
    const last = this.size[axis] - 1;
    const at = Math.min(Math.max((voxel - (this.factor - 1) / 2) / this.factor, 0), last);
    const low = Math.floor(at);
    return { low, high: Math.min(low + 1, last), share: at - low };
  }

  private between(x: Between, y: Between, z: Between): number {
    const along = (i: number, j: number) => {
      const row = (i * this.size[1] + j) * this.size[2];
      return this.blocks[row + z.low] * (1 - z.share) + this.blocks[row + z.high] * z.share;
    };
    const across = (i: number) => along(i, y.low) * (1 - y.share) + along(i, y.high) * y.share;
    return across(x.low) * (1 - x.share) + across(x.high) * x.share;
  }
}
