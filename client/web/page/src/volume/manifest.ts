// Groups of 32³ voxels, and the manifest that names them. client/web/volume makes both.
import type { Vec3, VoxelType } from "../wire/messages";

export const kGroupEdge = 32;
export const kGroupVoxels = kGroupEdge ** 3;

export type Voxels = Uint8Array | Int16Array | Uint16Array | Float32Array;

export interface VolumeShape {
  size: Vec3; // voxels
  type: VoxelType;
  background: number;
  // The range when the volume was loaded. Later values may lie beyond it.
  valueMin: number;
  valueMax: number;
  factor: number; // a voxel is the mean of factor³ ones of the volume: 1 but in the overview
}

export interface Manifest {
  name: string;
  shape: VolumeShape;
  revision: number;
  contentHash: string; // palpated's, 32 hex digits
  overview: { name: string; size: Vec3; factor: number };
  // The blob of each group, "" where all voxels are background. Null: the gateway gives the overview alone.
  groups: string[] | null;
}

const kArrays = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, float32: Float32Array };

export function newVoxels(type: VoxelType, count: number): Voxels {
  return new kArrays[type](count);
}

// Throws if the bytes are not `count` voxels of the type.
export function voxelsOf(type: VoxelType, bytes: ArrayBuffer, count: number): Voxels {
  const array = kArrays[type];
  if (bytes.byteLength !== count * array.BYTES_PER_ELEMENT) throw new Error(`a blob of ${bytes.byteLength} bytes`);
  return new array(bytes); // little-endian, as every machine that runs a browser
}

export function bytesPerVoxel(type: VoxelType): number {
  return kArrays[type].BYTES_PER_ELEMENT;
}

export function groupCounts(size: Vec3): Vec3 {
  return size.map((edge) => Math.ceil(edge / kGroupEdge)) as Vec3;
}

export function groupNumber(counts: Vec3, a: number, b: number, c: number): number {
  return (a * counts[1] + b) * counts[2] + c;
}

export function groupPlace(counts: Vec3, number: number): Vec3 {
  const ab = Math.floor(number / counts[2]);
  return [Math.floor(ab / counts[1]), ab % counts[1], number % counts[2]];
}

const kHex = Array.from({ length: 256 }, (_, byte) => byte.toString(16).padStart(2, "0"));
const kNameBytes = 16;
const kNoName = "00".repeat(kNameBytes);

function decodeNames(base64: string): string[] {
  const text = atob(base64);
  return Array.from({ length: Math.floor(text.length / kNameBytes) }, (_, n) => {
    const bytes = text.slice(kNameBytes * n, kNameBytes * (n + 1));
    const name = Array.from(bytes, (byte) => kHex[byte.charCodeAt(0)]).join("");
    return name === kNoName ? "" : name;
  });
}

// The manifest's JSON. Throws if it does not name every group of its lattice.
export function parseManifest(name: string, text: string): Manifest {
  const json = JSON.parse(text);
  const { size, voxel_type, background, value_min, value_max } = json.lattice;
  const shape: VolumeShape = { size, type: voxel_type, background, valueMin: value_min, valueMax: value_max, factor: 1 };
  if (!(shape.type in kArrays)) throw new Error(`voxels of type ${shape.type}`);
  const groups = json.groups === "" ? null : decodeNames(json.groups);
  const [a, b, c] = groupCounts(size);
  if (groups && groups.length !== a * b * c) throw new Error("a manifest without some of its groups");
  return { name, shape, revision: json.revision, contentHash: json.content_hash, overview: json.overview, groups };
}
