// How many pixels are cast at once, so that frames go on. It follows what earlier ones took.

const kSlowMs = 50;
// A tile takes a frame or two however small it is. Where frames are slow, small tiles would take minutes.
const kFewestPixels = 8192;

export class Pace {
  pixels = kFewestPixels;

  // `atOnce`: the first look has found them done, so they took a frame at most.
  took(pixels: number, ms: number, atOnce: boolean): void {
    if (ms > kSlowMs && !atOnce) this.pixels = Math.max(pixels / 2, kFewestPixels);
    else if ((atOnce || ms < kSlowMs / 3) && 2 * pixels > this.pixels) this.pixels *= 2;
  }
}
