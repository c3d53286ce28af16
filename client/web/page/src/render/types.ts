// The volume as the renderer sees it.
export type { Vec3, VoxelType } from "../wire/messages";
import type { Vec3, VoxelType } from "../wire/messages";

export type Voxels = Uint8Array | Int16Array | Uint16Array | Float32Array;

export interface VolumeShape {
  size: Vec3;
  type: VoxelType;
  background: number;
  valueMin: number;
  valueMax: number;
}
