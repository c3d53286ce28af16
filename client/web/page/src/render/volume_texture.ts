// A whole volume on the graphics card. Skeleton: the interface stays as it is here.
import type { VolumeShape, Voxels } from "./types";

export class VolumeTexture {
  // Returns "" if a volume of this shape fits the budget and the card, and otherwise why not.
  static problem(_gl: WebGL2RenderingContext, _shape: VolumeShape, _budgetBytes: number): string {
    return "";
  }

  // Everything is background. Throws an Error if the card has no memory for it.
  constructor(
    _gl: WebGL2RenderingContext,
    readonly shape: VolumeShape,
  ) {}

  // Group (a, b, c) has voxels 32a .. 32a + 31 and so on: (i, j, k) at 1024 i + 32 j + k. The array
  // is not kept. The caster draws all groups that were put before its next step().
  putGroup(_a: number, _b: number, _c: number, _voxels: Voxels): void {}

  dispose(): void {}

  // On the graphics card.
  readonly bytes: number = 0;
}
