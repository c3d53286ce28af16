// How many pixels are cast at once, so that frames go on. It follows what earlier ones took.

const kSlowMs = 50;
const kFewestPixels = 1024;

export class Pace {
  pixels = 8 * kFewestPixels;

  // `atOnce`: the first look has found them done, so they took a frame at most.
  took(pixels: number, ms: number, atOnce: boolean): void {
    if (ms > kSlowMs && !atOnce) this.pixels = Math.max(pixels / 2, kFewestPixels);
    else if ((atOnce || ms < kSlowMs / 3) && 2 * pixels > this.pixels) this.pixels *= 2;
  }
}
