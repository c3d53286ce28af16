// Scales values for the graphics card as client/view/render/brick_cache.h does, which says why: by a
// power of two, so that the largest is near 2^32.

const kLargestExponent = 32;
const kMost = 2 ** 50;

function floatNotAbove(value: number): number {
  const nearest = Math.fround(value);
  if (nearest <= value) return nearest;
  // The float before: one step of the bits, up for negative values.
  const bits = new Int32Array(Float32Array.of(nearest).buffer);
  if (nearest === 0) return -(2 ** -149);
  bits[0] += nearest > 0 ? -1 : 1;
  return new Float32Array(bits.buffer)[0];
}

export class ValueScale {
  readonly factor: number = 1;

  constructor(min: number, max: number) {
    const largest = Math.max(Math.abs(min), Math.abs(max));
    if (!(largest > 0) || !Number.isFinite(largest)) return;
    // log2 may round up just below a power of two.
    let exponent = Math.floor(Math.log2(largest));
    if (2 ** exponent > largest) --exponent;
    this.factor = 2 ** (kLargestExponent - exponent);
  }

  scaled(value: number): number {
    return Math.min(Math.max(value * this.factor, -kMost), kMost);
  }

  // Two floats whose sum is the scaled value. The first is the greatest that is not above it.
  split(value: number): [number, number] {
    const scaled = this.scaled(value);
    const first = floatNotAbove(scaled);
    return [first, floatNotAbove(scaled - first)];
  }
}
