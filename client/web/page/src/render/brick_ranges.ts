// The exact ranges of values in cell bricks (8³ cells) and blocks (64³ cells) of frame P, kept as groups
// of voxels arrive.
//
// Cell brick b has the voxels 8b - 1 .. 8b + 7 along each axis: all of voxel brick b, and the last layer of
// the one before. So a voxel brick keeps eight ranges, one for each set of axes along which only its last
// layer counts, and a cell brick's range is the union of one of each of eight voxel bricks.
import { groupCounts, groupNumber as numberOf, groupPlace as placeOf, kGroupEdge, newVoxels } from "../volume/manifest";
import type { VolumeShape, Voxels } from "../volume/manifest";
import type { Vec3 } from "../wire/messages";
import type { ValueScale } from "./value_scale";

const kBricks = 4; // voxel bricks in a group, along each axis

export class BrickRanges {
  readonly brickCount: Vec3;
  readonly blockCount: Vec3;
  // The least and the greatest scaled value of each; z runs fastest.
  readonly bricks: Float32Array;
  readonly blocks: Float32Array;

  private readonly groupCount: Vec3;
  private readonly pieceCount: Vec3; // voxel bricks, with a layer of background on every side
  // Of voxel brick n and a set of axes (4: x, 2: y, 1: z): the least and the greatest value, at 16 n + 2 set.
  private readonly pieces: Voxels;
  private readonly changed = new Set<number>(); // groups

  constructor(
    shape: VolumeShape,
    private readonly scale: ValueScale,
  ) {
    this.groupCount = groupCounts(shape.size);
    this.pieceCount = this.groupCount.map((count) => kBricks * count + 2) as Vec3;
    this.brickCount = shape.size.map((size) => Math.ceil((size + 1) / 8)) as Vec3;
    this.blockCount = shape.size.map((size) => Math.ceil((size + 1) / 64)) as Vec3;
    const volume = ([x, y, z]: Vec3): number => x * y * z;
    this.pieces = newVoxels(shape.type, 16 * volume(this.pieceCount)).fill(shape.background);
    this.bricks = new Float32Array(2 * volume(this.brickCount)).fill(scale.scaled(shape.background));
    this.blocks = new Float32Array(2 * volume(this.blockCount)).fill(scale.scaled(shape.background));
  }

  putGroup(a: number, b: number, c: number, voxels: Voxels): void {
    for (let n = 0; n < kBricks ** 3; ++n) {
      const [x, y, z] = [n >> 4, (n >> 2) & 3, n & 3];
      const piece = numberOf(this.pieceCount, kBricks * a + x + 1, kBricks * b + y + 1, kBricks * c + z + 1);
      const first = 8 * ((x * kGroupEdge + y) * kGroupEdge + z);
      for (let set = 0; set < 8; ++set) this.putPiece(16 * piece + 2 * set, voxels, first, set);
    }
    this.changed.add(numberOf(this.groupCount, a, b, c));
  }

  // Brings bricks and blocks up to date. Returns the first and the last changed layer of bricks along x, or
  // null if nothing has changed.
  update(): [number, number] | null {
    if (this.changed.size === 0) return null;
    const blocks = new Set<number>();
    let [first, last] = [Infinity, 0];
    for (const group of this.changed) {
      const from = placeOf(this.groupCount, group).map((g) => kBricks * g) as Vec3;
      const to = from.map((f, axis) => Math.min(f + kBricks, this.brickCount[axis] - 1)) as Vec3;
      first = Math.min(first, from[0]);
      last = Math.max(last, to[0]);
      forEach(from, to, (x, y, z) => {
        this.updateBrick(x, y, z);
        blocks.add(numberOf(this.blockCount, x >> 3, y >> 3, z >> 3));
      });
    }
    for (const block of blocks) this.updateBlock(block);
    this.changed.clear();
    return [first, last];
  }

  // Of the voxel brick whose first voxel is at `first` of a group.
  private putPiece(to: number, voxels: Voxels, first: number, set: number): void {
    const fromI = set & 4 ? 7 : 0;
    const fromJ = set & 2 ? 7 : 0;
    const fromK = set & 1 ? 7 : 0;
    let low = Infinity;
    let high = -Infinity;
    for (let i = fromI; i < 8; ++i) {
      for (let j = fromJ; j < 8; ++j) {
        const row = first + (i * kGroupEdge + j) * kGroupEdge;
        for (let n = row + fromK; n < row + 8; ++n) {
          const value = voxels[n];
          if (value < low) low = value;
          if (value > high) high = value;
        }
      }
    }
    this.pieces[to] = low;
    this.pieces[to + 1] = high;
  }

  private updateBrick(x: number, y: number, z: number): void {
    let low = Infinity;
    let high = -Infinity;
    for (let set = 0; set < 8; ++set) {
      const piece = numberOf(this.pieceCount, x + 1 - (set >> 2), y + 1 - ((set >> 1) & 1), z + 1 - (set & 1));
      low = Math.min(low, this.pieces[16 * piece + 2 * set]);
      high = Math.max(high, this.pieces[16 * piece + 2 * set + 1]);
    }
    const to = 2 * numberOf(this.brickCount, x, y, z);
    this.bricks[to] = this.scale.scaled(low);
    this.bricks[to + 1] = this.scale.scaled(high);
  }

  private updateBlock(block: number): void {
    const from = placeOf(this.blockCount, block).map((b) => 8 * b) as Vec3;
    const to = from.map((f, axis) => Math.min(f + 7, this.brickCount[axis] - 1)) as Vec3;
    let low = Infinity;
    let high = -Infinity;
    forEach(from, to, (x, y, z) => {
      const at = 2 * numberOf(this.brickCount, x, y, z);
      low = Math.min(low, this.bricks[at]);
      high = Math.max(high, this.bricks[at + 1]);
    });
    this.blocks[2 * block] = low;
    this.blocks[2 * block + 1] = high;
  }
}

// Both ends are included.
function forEach(from: Vec3, to: Vec3, f: (x: number, y: number, z: number) => void): void {
  for (let x = from[0]; x <= to[0]; ++x) {
    for (let y = from[1]; y <= to[1]; ++y) {
      for (let z = from[2]; z <= to[2]; ++z) f(x, y, z);
    }
  }
}
