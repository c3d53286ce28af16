// The shape of a volume as the renderer sees it. Lengths are in voxels, values in data units.

export type Vec3 = [number, number, number];

export type VoxelType = "uint8" | "int16" | "uint16" | "float32";
export type Voxels = Uint8Array | Int16Array | Uint16Array | Float32Array;

export interface VolumeShape {
  size: Vec3;
  type: VoxelType;
  background: number;
  // The range when the volume was loaded. Later values may lie beyond it.
  valueMin: number;
  valueMax: number;
}
