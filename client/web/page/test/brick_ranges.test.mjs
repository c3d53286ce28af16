// The ranges of bricks and blocks against all voxels of each, for random volumes and changes.
import assert from "node:assert/strict";
import { test } from "node:test";

import { build } from "esbuild";

async function load() {
  const contents = `
    export { BrickRanges } from "./src/render/brick_ranges";
    export { ValueScale } from "./src/render/value_scale";`;
  const page = new URL("..", import.meta.url).pathname;
  const options = { absWorkingDir: page, bundle: true, format: "esm", write: false };
  const { outputFiles } = await build({ ...options, stdin: { contents, resolveDir: page } });
  return import(`data:text/javascript;base64,${Buffer.from(outputFiles[0].text).toString("base64")}`);
}

const { BrickRanges, ValueScale } = await load();
const arrays = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, float32: Float32Array };

let state = 1;
// From 0 to 1, the same in each run.
function random() {
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return state / 2 ** 32;
}

class Volume {
  constructor(shape) {
    this.shape = shape;
    this.voxels = new arrays[shape.type](shape.size.reduce((a, b) => a * b)).fill(shape.background);
  }

  at(p) {
    const { size, background } = this.shape;
    return p.every((n, axis) => n >= 0 && n < size[axis]) ? this.voxels[this.place(p)] : background;
  }

  place([i, j, k]) {
    return (i * this.shape.size[1] + j) * this.shape.size[2] + k;
  }

  group(place) {
    const from = place.map((n) => 32 * n);
    return new arrays[this.shape.type](32 ** 3).map((_, n) =>
      this.at([from[0] + (n >> 10), from[1] + ((n >> 5) & 31), from[2] + (n & 31)]),
    );
  }

  // Of the cells from `first` on, `edge` along each axis. Cell 0 has voxels -1 and 0.
  range(first, edge) {
    let [low, high] = [Infinity, -Infinity];
    const end = first.map((n, axis) => Math.min(n + edge - 1, this.shape.size[axis]));
    for (let i = first[0] - 1; i <= end[0]; ++i) {
      for (let j = first[1] - 1; j <= end[1]; ++j) {
        for (let k = first[2] - 1; k <= end[2]; ++k) {
          const value = this.at([i, j, k]);
          low = Math.min(low, value);
          high = Math.max(high, value);
        }
      }
    }
    return [low, high];
  }
}

function check(volume, ranges, scale) {
  for (const [counts, found, edge] of [
    [ranges.brickCount, ranges.bricks, 8],
    [ranges.blockCount, ranges.blocks, 64],
  ]) {
    assert.deepEqual(counts, volume.shape.size.map((size) => Math.ceil((size + 1) / edge)));
    const [, ny, nz] = counts;
    for (let n = 0; n < found.length / 2; ++n) {
      const place = [Math.floor(n / (ny * nz)), Math.floor(n / nz) % ny, n % nz];
      const exact = volume.range(place.map((m) => m * edge), edge).map((value) => scale.scaled(value));
      assert.deepEqual([found[2 * n], found[2 * n + 1]], exact, `edge ${edge} at ${place}`);
    }
  }
}

for (const [size, type, background, low, high] of [
  [[40, 7, 33], "uint8", 0, 0, 255],
  [[32, 64, 65], "int16", -1000, -1000, 3000],
  [[1, 1, 1], "uint16", 7, 0, 65535],
  [[31, 70, 9], "float32", 0.25, -1e-20, 1],
]) {
  test(`ranges are exact after each change: ${type}, ${size}`, () => {
    const shape = { size, type, background, valueMin: low, valueMax: high };
    const volume = new Volume(shape);
    const scale = new ValueScale(low, high);
    const ranges = new BrickRanges(shape, scale);
    assert.equal(ranges.update(), null);
    check(volume, ranges, scale);
    for (let change = 0; change < 8; ++change) {
      const changed = new Set();
      for (let n = 0; n < 1 + 40 * random(); ++n) {
        const p = size.map((m) => Math.floor(m * random()));
        volume.voxels[volume.place(p)] = n % 3 ? low + (high - low) * random() : background;
        changed.add(JSON.stringify(p.map((m) => m >> 5)));
      }
      for (const text of changed) ranges.putGroup(...JSON.parse(text), volume.group(JSON.parse(text)));
      const [first, last] = ranges.update();
      assert.ok(first >= 0 && first <= last && last < ranges.brickCount[0]);
      check(volume, ranges, scale);
    }
  });
}

test("a scaled value is split into two floats, the first the greatest that is not above it", () => {
  const scale = new ValueScale(-1000, 3000);
  assert.equal(scale.factor, 2 ** 21);
  const bitsOf = (value) => new Int32Array(Float32Array.of(value).buffer)[0];
  const floatOf = (bits) => new Float32Array(Int32Array.of(bits).buffer)[0];
  for (let n = 0; n < 1000; ++n) {
    const exact = (-1000 + 4000 * random()) * scale.factor;
    const [first, second] = scale.split(exact / scale.factor);
    assert.deepEqual([first, second].map(Math.fround), [first, second]);
    assert.ok(first <= exact && floatOf(bitsOf(first) + (first < 0 ? -1 : 1)) > exact);
    assert.ok(second >= 0 && first + second <= exact && exact - first - second < 2 ** -14);
  }
  for (const [min, max] of [[0, 0], [NaN, 1], [0, Infinity]]) assert.equal(new ValueScale(min, max).factor, 1);
  assert.equal(new ValueScale(0, 2 ** 10 * (1 - 2 ** -53)).factor, 2 ** 23);
  assert.equal(new ValueScale(0, 1).scaled(1e30), 2 ** 50);
});
