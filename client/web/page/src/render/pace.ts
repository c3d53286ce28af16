// How much is cast at once, so that frames go on: the coarseness of a picture that has to come at once, and
// the size of a tile of a fine one. Both follow what earlier ones took.

const kSlowMs = 50;
const kCoarsest = 8;
const kFewestPixels = 1024;

export class Pace {
  // Pixels per cast pixel along a side.
  coarseLevel = kCoarsest;
  private tooFine = 0;
  private tilePixels = 16 * kFewestPixels;

  rows(width: number): number {
    return Math.max(1, Math.floor(this.tilePixels / width));
  }

  // `atOnce`: the first look has found it done, so it took about a frame at most.
  tookForCoarse(ms: number, atOnce: boolean): void {
    if (ms > kSlowMs && !atOnce && this.coarseLevel < kCoarsest) {
      this.tooFine = this.coarseLevel;
      this.coarseLevel *= 2;
    } else if ((atOnce || ms < kSlowMs / 3) && this.coarseLevel / 2 > this.tooFine) {
      this.coarseLevel = Math.max(1, this.coarseLevel / 2);
    }
  }

  tookForTile(ms: number, atOnce: boolean): void {
    if (ms > kSlowMs && !atOnce) this.tilePixels = Math.max(this.tilePixels / 2, kFewestPixels);
    else if (atOnce || ms < kSlowMs / 3) this.tilePixels *= 2;
  }

  // Pictures of another size or volume take another time.
  forget(): void {
    this.tooFine = 0;
  }
}
