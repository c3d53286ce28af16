// The page's pictures against rays in double precision: every pixel's distance, silhouettes, and what an edit
// changes. In chromium, which draws in software.
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";

import { Harness } from "./caster_harness.mjs";
import { firstHit, randomNumbers, Volume } from "./cast_reference.mjs";

const kBoundVoxels = 0.05;

const sub = (a, b) => a.map((x, n) => x - b[n]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a.reduce((sum, x, n) => sum + x * b[n], 0);
const unit = (a) => a.map((x) => x / Math.hypot(...a));
const row = (map, n) => map.slice(4 * n, 4 * n + 3);
const apply = (map, p) => [0, 1, 2].map((n) => dot(row(map, n), p) + map[4 * n + 3]);

// Solves map · x = d for directions, by Cramer's rule.
function indexDirection(map, d) {
  const columns = [0, 1, 2].map((c) => [map[c], map[4 + c], map[8 + c]]);
  const determinant = dot(columns[0], cross(columns[1], columns[2]));
  return [0, 1, 2].map((n) => dot(d, cross(columns[(n + 1) % 3], columns[(n + 2) % 3])) / determinant);
}

// A camera that looks at `target` from `eye`, 35° high, and the exact direction of each of its pixels.
function view(size, eye, target) {
  const back = unit(sub(eye, target));
  const right = unit(cross([0, 1, 0], back));
  const up = cross(back, right);
  const distance = Math.hypot(...sub(eye, target));
  const half = Math.tan((17.5 * Math.PI) / 180);
  const aspect = size[0] / size[1];
  const [near, far] = [0.01 * distance, 4 * distance];
  const viewFromD = [...right, -dot(right, eye), ...up, -dot(up, eye), ...back, -dot(back, eye), 0, 0, 0, 1];
  const clipFromView = [1 / (half * aspect), 0, 0, 0, 0, 1 / half, 0, 0];
  clipFromView.push(0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near), 0, 0, -1, 0);
  const clipFromD = Array.from({ length: 16 }, (_, n) =>
    [0, 1, 2, 3].reduce((sum, k) => sum + clipFromView[4 * (n % 4) + k] * viewFromD[4 * k + (n >> 2)], 0),
  );
  const directionOf = (x, y) => {
    const across = half * aspect * ((2 * (x + 0.5)) / size[0] - 1);
    const above = half * (1 - (2 * (y + 0.5)) / size[1]);
    return unit([0, 1, 2].map((n) => across * right[n] + above * up[n] - back[n]));
  };
  return { size, eye, clipFromD, directionOf };
}

function requestOf(camera, map, isovalue, more = {}) {
  return {
    size: camera.size,
    eye: camera.eye,
    clipFromD: camera.clipFromD,
    deviceFromIndex: map,
    isovalue,
    materialAbove: true,
    color: [0.87, 0.8, 0.7],
    veils: [],
    veilOpacity: 0.5,
    ...more,
  };
}

// Of all pixels, the top row first: mm, and voxels per mm along the ray.
function expected(volume, camera, map, isovalue) {
  const toIndex = (d) => indexDirection(map, d);
  const origin = toIndex(sub(camera.eye, [map[3], map[7], map[11]]));
  return Array.from({ length: camera.size[0] * camera.size[1] }, (_, n) => {
    const direction = toIndex(camera.directionOf(n % camera.size[0], Math.floor(n / camera.size[0])));
    return { mm: firstHit(volume, origin, direction, isovalue), voxelsPerMm: Math.hypot(...direction) };
  });
}

function compare(found, rays, [width, height], least) {
  assert.equal(found.length, rays.length);
  const isHit = (n) => rays[n].mm < Infinity;
  const nearBorder = (n) => {
    const [x, y] = [n % width, Math.floor(n / width)];
    for (let v = Math.max(y - 1, 0); v <= Math.min(y + 1, height - 1); ++v) {
      for (let u = Math.max(x - 1, 0); u <= Math.min(x + 1, width - 1); ++u) {
        if (isHit(v * width + u) !== isHit(n)) return true;
      }
    }
    return false;
  };
  let [both, worst] = [0, 0];
  rays.forEach((ray, n) => {
    const hits = [found[n] < Infinity, isHit(n)];
    if (hits[0] !== hits[1]) assert.ok(nearBorder(n), `pixel ${n} of ${width} x ${height} is not at a silhouette`);
    if (!hits[0] || !hits[1]) return;
    ++both;
    const apart = Math.abs(found[n] - ray.mm) * ray.voxelsPerMm;
    assert.ok(apart <= kBoundVoxels, `pixel ${n} of ${width} x ${height}: ${apart} voxels apart`);
    worst = Math.max(worst, apart);
  });
  assert.ok(both >= least, `only ${both} pixels hit`);
  return { both, worst };
}

// Balls of some radius all over the volume: `value` at their centres, falling to 0 and below outside.
function ballField(size, seed, steep) {
  const random = randomNumbers(seed);
  const balls = Array.from({ length: 9 }, () => ({
    centre: size.map((n) => random() * (n - 1)),
    radius: 4 + 6 * random(),
  }));
  return (i, j, k) => Math.max(...balls.map(({ centre, radius }) => steep * (radius - Math.hypot(...sub([i, j, k], centre)))));
}

const kStraight = [1, 0, 0, -20, 0, 1, 0, -24, 0, 0, 1, -30];
// Mirrored, of three edges, sheared, turned.
const kSheared = [0.9, 0.35, -0.2, -10, -0.3, 0.7, 0.25, -12, 0.15, -0.4, -1.6, 40];
const centreOf = (shape, map) => apply(map, shape.size.map((n) => (n - 1) / 2));
const shapeOf = (size, type, background, valueMin, valueMax) => ({ size, type, background, valueMin, valueMax });

const kFields = [
  {
    name: "balls in uint8 along the axes",
    shape: shapeOf([40, 48, 60], "uint8", 0, 0, 255),
    value: (size) => (i, j, k) => Math.min(Math.max(128 + ballField(size, 1, 20)(i, j, k), 0), 255),
    isovalues: [128, 127.37],
    map: kStraight,
    away: [40, 60, 110],
  },
  {
    name: "balls in int16, sheared and mirrored, with a background",
    shape: shapeOf([33, 64, 31], "int16", -1000, -1000, 2400),
    value: (size) => (i, j, k) => Math.min(Math.max(300 + ballField(size, 2, 180)(i, j, k), -1000), 2400),
    isovalues: [300.6],
    map: kSheared,
    away: [-70, 30, 90],
  },
  {
    name: "balls in uint16, from along an axis",
    shape: shapeOf([65, 7, 32], "uint16", 700, 100, 65535),
    value: (size) => (i, j, k) => Math.min(Math.max(30000 + ballField(size, 3, 4000)(i, j, k), 100), 65535),
    isovalues: [30000],
    map: kStraight,
    away: [0, 0, 70],
  },
  {
    name: "balls in float32, small differences of large values",
    shape: shapeOf([37, 50, 41], "float32", 9999000, 9999000, 10001000),
    value: (size) => (i, j, k) => 1e7 + ballField(size, 4, 3)(i, j, k),
    isovalues: [1e7 + 0.4], // between two floats
    map: kSheared,
    away: [50, -80, 60],
  },
  {
    name: "tiny floats",
    shape: shapeOf([32, 32, 64], "float32", 0, -3e-30, 1e-29),
    value: (size) => (i, j, k) => 1e-30 * ballField(size, 5, 1)(i, j, k),
    isovalues: [1e-31],
    map: kStraight,
    away: [-60, 50, -90],
  },
  {
    name: "random bytes",
    shape: shapeOf([34, 29, 66], "uint8", 9, 0, 255),
    value: () => {
      const random = randomNumbers(6);
      return () => 256 * random() * random() - 0.5;
    },
    isovalues: [120.5, 60],
    map: kSheared,
    away: [40, 30, 55],
  },
  {
    name: "random floats",
    shape: shapeOf([29, 35, 33], "float32", 0, -1, 1),
    value: () => {
      const random = randomNumbers(7);
      return () => 2 * random() - 1;
    },
    isovalues: [0.8, -0.001],
    map: kStraight,
    away: [20, 70, 50],
  },
];

describe("the page's caster", () => {
  let harness;
  before(async () => (harness = await Harness.start()));
  after(() => harness.stop());

  async function show(volume) {
    await harness.call("begin", volume.shape);
    await harness.put(volume.groups());
  }

  test("can cast here", async () => assert.equal(await harness.call("problem"), ""));

  for (const { name, shape, value, isovalues, map, away } of kFields) {
    test(`every pixel is exact: ${name}`, async (t) => {
      const volume = new Volume(shape, value(shape.size));
      await show(volume);
      const centre = centreOf(shape, map);
      const camera = view([81, 61], centre.map((x, n) => x + away[n]), centre);
      for (const isovalue of isovalues) {
        await harness.cast(requestOf(camera, map, isovalue));
        const { both, worst } = compare(await harness.distances(), expected(volume, camera, map, isovalue), camera.size, 300);
        t.diagnostic(`${both} pixels, at most ${worst.toFixed(5)} voxels apart`);
      }
    });
  }

  test("from inside, and where material reaches the border", async () => {
    const shape = shapeOf([40, 40, 40], "uint8", 0, 0, 255);
    const volume = new Volume(shape, (i, j, k) => (Math.hypot(i - 20, j - 20, k - 20) < 12 ? 20 : 200));
    await show(volume);
    const centre = centreOf(shape, kStraight);
    for (const eye of [centre, [60, 50, 80]]) {
      const camera = view([61, 45], eye, eye === centre ? sub(eye, [1, 2, 3]) : centre);
      await harness.cast(requestOf(camera, kStraight, 100));
      compare(await harness.distances(), expected(volume, camera, kStraight, 100), camera.size, 300);
    }
  });

  test("nothing is hit where all values are on one side", async () => {
    const shape = shapeOf([20, 20, 20], "uint16", 5, 5, 100);
    await show(new Volume(shape, (i) => 5 + i));
    const camera = view([40, 30], [60, 50, 80], centreOf(shape, kStraight));
    await harness.cast(requestOf(camera, kStraight, 4.5));
    assert.ok((await harness.distances()).every((mm) => mm === Infinity));
  });

  test("one changed group changes the surface there and nowhere else", async () => {
    const shape = shapeOf([70, 70, 70], "int16", 0, -100, 1000);
    const volume = new Volume(shape, ballField(shape.size, 8, 50));
    await show(volume);
    const centre = centreOf(shape, kStraight);
    const camera = view([81, 61], centre.map((x, n) => x + [50, 70, 120][n]), centre);
    const request = requestOf(camera, kStraight, 20);
    await harness.cast(request);
    const untouched = await harness.distances();

    const was = volume.group(1, 1, 1);
    const random = randomNumbers(9);
    for (let n = 0; n < 32 ** 3; ++n) volume.set(32 + (n >> 10), 32 + ((n >> 5) & 31), 32 + (n & 31), random() < 0.02 ? 900 : -90);
    await harness.put([volume.group(1, 1, 1)]);
    await harness.cast(request);
    const edited = await harness.distances();
    compare(edited, expected(volume, camera, kStraight, 20), camera.size, 300);
    const changed = edited.filter((mm, n) => mm !== untouched[n]).length;
    assert.ok(changed > 100 && changed < edited.length / 2, `${changed} pixels changed`);

    await harness.put([was]);
    await harness.cast(request);
    assert.deepEqual(await harness.distances(), untouched);
  });

  test("a change is shown coarsely at first, and then finely", async () => {
    const shape = shapeOf([40, 40, 40], "uint8", 0, 0, 255);
    await show(new Volume(shape, ballField(shape.size, 10, 20)));
    const camera = view([321, 241], [80, 60, 90], centreOf(shape, kStraight));
    const levels = await harness.cast(requestOf(camera, kStraight, 100));
    assert.deepEqual(levels, [...levels].sort((a, b) => b - a));
    assert.ok(levels.length >= 2 && levels[0] > 1, String(levels));
    assert.equal(levels.at(-1), 1);
    assert.equal((await harness.distances()).length, 321 * 241);
  });

  test("colour goes over what is there, the veil over what is behind it", async () => {
    const shape = shapeOf([40, 40, 40], "uint8", 0, 0, 255);
    await show(new Volume(shape, (i, j, k) => Math.max(0, 255 - 12 * Math.hypot(i - 20, j - 20, k - 20))));
    const camera = view([61, 61], [-1, 20, 130], centreOf(shape, kStraight));
    const veils = [{ isovalue: 60, color: [0, 0, 1] }];
    await harness.cast(requestOf(camera, kStraight, 150, { color: [1, 0, 0], veils }));
    const distances = await harness.distances();
    const pixel = (colors, n) => [...colors.subarray(4 * n, 4 * n + 3)];
    const [middle, corner] = [30 * 61 + 30, 0];
    const background = [0, 1, 0, 1];

    const surface = await harness.draw(background, 1, ["draw"]);
    for (let n = 0; n < distances.length; ++n) {
      assert.equal(pixel(surface, n)[1] === 255, distances[n] === Infinity, `pixel ${n}`);
    }
    const both = await harness.draw(background, 1, ["draw", "drawVeil"]);
    assert.deepEqual(pixel(both, corner), [0, 255, 0]);
    assert.ok(pixel(both, middle)[2] > 40 && pixel(both, middle)[0] > 0);
    assert.ok(pixel(both, middle)[0] < pixel(surface, middle)[0]);
    // Everything lies before the veil.
    assert.deepEqual(await harness.draw(background, 0, ["drawVeil"]), await harness.draw(background, 0, []));
    // A ray beside the surface passes two layers of the veil: a quarter of what is behind is left.
    const beside = distances.findIndex((mm, n) => mm === Infinity && pixel(both, n)[2] > 0 && n >= 30 * 61);
    assert.ok(Math.abs(pixel(both, beside)[1] - 64) <= 60, String(pixel(both, beside)));
  });

  test("says what does not fit", async () => {
    const shape = shapeOf([512, 512, 512], "float32", 0, 0, 1);
    assert.notEqual(await harness.call("volumeProblem", shape, 256), "");
    assert.notEqual(await harness.call("volumeProblem", shapeOf([100000, 2, 2], "uint8", 0, 0, 1), 1024), "");
    assert.equal(await harness.call("volumeProblem", shapeOf([256, 256, 256], "uint8", 0, 0, 255), 256), "");
  });

  test("WebGL has nothing to complain about", async () => {
    assert.equal(await harness.call("glError"), 0);
    const isSlow = (text) => text.includes("GPU stall due to ReadPixels"); // the test reads pixels
    assert.deepEqual(harness.complaints.filter((text) => !isSlow(text)), []);
  });
});
