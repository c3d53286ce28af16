// The page's copy of the volume.
import type { VolumeShape, Voxels } from "../render/types";
import type { State } from "../state";

// A slice: value (x, y) is at y * width + x. Across axis 0, x is j and y is k; across 1, i and k; across 2, i and j.
export interface Plane {
  width: number;
  height: number;
  values: Float32Array;
}

// Indices are voxels of the copy's shape: of blocks of factor³ voxels if it is the overview.
export class VolumeCopy {
  shape: VolumeShape | null = null; // null: no volume yet
  factor = 1;
  groupsLeft = 0;
  groupsAll = 0;
  revision = 0;
  contentHash = "";
  isOverview = false;
  whyOverview = "";

  constructor(private readonly state: State) {}

  value(_i: number, _j: number, _k: number): number {
    return this.shape?.background ?? 0;
  }

  plane(_axis: 0 | 1 | 2, _index: number): Plane {
    return { width: 0, height: 0, values: new Float32Array(0) };
  }

  get memoryBytes(): number {
    return 0;
  }

  // Numbers and voxels of the groups that are there.
  *groups(): Iterable<[number, Voxels]> {
    if (!this.state.hello) return;
  }
}
