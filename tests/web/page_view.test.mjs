// The camera, the address and the sources of the page.
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { assertNear, modules, pageFolder, random } from "./page_harness.mjs";

const { Camera, boundsIn, uprightPatient, readFragment, writeFragment, faceLabels, lettersOf, patientFrame, planeName, inverse, compose, apply, indexFromBlocks, State } =
  await modules("view/camera.ts", "view/fragment.ts", "view/geometry.ts", "view/patient_axes.ts", "state.ts");

// The numbers of both tests are what the desktop viewer's Camera gives for the same calls.
test("the camera fits a box as the desktop viewer's", () => {
  const bounds = { min: [-40, -30, -20], max: [50, 35, 25] };
  const camera = new Camera();
  camera.fit(bounds);
  assertNear(assert, [camera.distanceMm, ...camera.target], [181.193463275, 5, 2.5, 2.5], 1e-10);
  assertNear(assert, camera.eye(), [90.1330801873, 64.4718142791, 149.954820289], 1e-10);
  assertNear(assert, camera.clipFromD([640, 480], bounds), [
    2.060011252, -0.5423746544, -0.6620800236, -0.4698463104, 0, 2.980324232, -0.4819548426, -0.3420201433,
    -1.189348051, -0.9394204582, -1.14675624, -0.8137976813, -7.326686133, -2.390386162, 135.9664534, 186.4322394,
  ], 1e-8);
});

test("the camera keeps a patient upright as the desktop viewer's", () => {
  const camera = new Camera();
  camera.upright = uprightPatient([0.1, 0.4, 0, 7, 0, 0, 0.6, 8, -0.4, 0.1, 0, 9], [0.9, 0.1, 0, 1, -0.1, 0.9, 0, 2, 0, 0, 1.5, 3]);
  assertNear(assert, camera.upright, [0.3481865296, 0, 0.937425272, 0, 0, 1, 0, 0, -0.937425272, 0, 0.3481865296, 0], 1e-9);
  camera.set([3, -4, 5], 200, -35, 180);
  camera.pan(12, -7, [300, 500]);
  assert.equal(camera.azimuthDeg, -160);
  assertNear(assert, camera.target, [4.548919768, -6.169532239, 0.4697760483], 1e-9);
  assertNear(assert, camera.eye(), [-142.8952659, -109.4132908, -0.4989511887], 1e-9);
  assertNear(assert, camera.clipFromD([300, 500], { min: [-40, -30, -20], max: [50, 35, 25] }), [
    -0.02083733547, -1.091467669, 1.137133531, 0.8191343649, 0, 1.55881102, 0.7962466558, 0.5735764364, 3.171526351,
    -0.007171082772, 0.007471113351, 0.005381817984, -1.395119749, 14.5855025, 125.8241522, 179.8099936,
  ], 1e-8);
});

test("maps: inverse, composition, blocks", () => {
  const next = random(7);
  for (let n = 0; n < 100; ++n) {
    const [a, b] = [0, 1].map(() => Array.from({ length: 12 }, (_, at) => next() - 0.5 + (at % 5 === 0 ? 3 : 0)));
    const p = [next(), next(), next()];
    assertNear(assert, apply(inverse(a), apply(a, p)), p, 1e-12);
    assertNear(assert, apply(compose(a, b), p), apply(a, apply(b, p)), 1e-12);
  }
  assert.deepEqual(apply(indexFromBlocks(4), [0, 1, 2]), [1.5, 5.5, 9.5]);
  assert.deepEqual(boundsIn([0, -2, 0, 1, 1, 0, 0, 0, 0, 0, 1, 0], [0, 0, 0], [3, 4, 5]), { min: [-7, 0, 0], max: [1, 3, 5] });
});

const frameOf = (worldFromIndex, patientAxes) => patientFrame({ worldFromIndex }, { patientAxes });
const found = (frame) => Object.fromEntries(faceLabels(frame).map(({ label, axis, sign }) => [label, [axis, sign]]));

test("letters stand at the nearest faces, whatever the order and the spacings of the axes", () => {
  // i to inferior, j to the right, k to anterior and a little to the right.
  const voxels = [0, -9, -0.3, 0, 0, 0, -1, 0, -0.2, 0, 0, 0];
  assert.deepEqual(found(frameOf(voxels, "LPS")), { L: [1, -1], R: [1, 1], P: [2, -1], A: [2, 1], S: [0, -1], I: [0, 1] });
  // Not known, not there yet, mirrored: the axes of the world.
  for (const frame of [frameOf(voxels, ""), patientFrame({ worldFromIndex: voxels }, null), frameOf(voxels, "RPS")]) {
    assert.equal(frame.isKnown, false);
    assert.deepEqual(found(frame), { "+x": [1, -1], "−x": [1, 1], "+y": [2, -1], "−y": [2, 1], "+z": [0, -1], "−z": [0, 1] });
  }
  // x to inferior, y to the left, z to anterior, as somebody answered.
  assert.deepEqual(found(frameOf([2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], "ILA")), { I: [0, 1], S: [0, -1], L: [1, 1], R: [1, -1], A: [2, 1], P: [2, -1] });
});

test("oblique directions have the letters of their great components, oblique planes their angle", () => {
  const about = (axis, degrees) => {
    const [c, s] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
    return axis === 2 ? [c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0] : [1, 0, 0, 0, 0, c, -s, 0, 0, s, c, 0];
  };
  const towards = (degrees) => lettersOf([Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180), 0]);
  assert.deepEqual([3, 22, 23, -50].map(towards), ["L", "L", "LP", "AL"]);
  assert.equal(lettersOf([1, 1 + 1e-12, -1]), "LPI");
  assert.deepEqual([0, 1, 2].map((world) => planeName(about(2, 1.5), world)), ["sagittal", "coronal", "axial"]);
  // A pitch about the axis from right to left turns sagittal planes in themselves.
  assert.deepEqual([0, 1, 2].map((world) => planeName(about(0, -31.2), world)), ["sagittal", "oblique 31°", "oblique 31°"]);
});

test("an address keeps the room and the view", () => {
  const view = { ...new State().view, azimuthDeg: -123.456, elevationDeg: 7, distanceMm: 250.5, target: [1, -2, 3.25], follow: true, veil: -300, veilOpacity: 0.45, slices: true, cross: [1, 2.5, 300] };
  const { room, budgetMiB, isovalue, volume, view: read } = readFragment(writeFragment({ room: "a&b=c#d%", budgetMiB: 512, isovalue: -0.25, volume: "a&b.nrrd", view }, true));
  assert.deepEqual([isovalue, volume], [-0.25, "a&b.nrrd"]);
  assert.equal(room, "a&b=c#d%");
  assert.equal(budgetMiB, 512);
  const { azimuthDeg, elevationDeg, distanceMm, target, follow, veil, veilOpacity, slices, cross } = view;
  assert.deepEqual(read, { azimuthDeg, elevationDeg, distanceMm, target, follow, veil, veilOpacity, slices, cross });
  assert.deepEqual(readFragment(writeFragment({ room: null, budgetMiB: null, isovalue: null, volume: null, view }, false)), { room: null, budgetMiB: null, volume: null, isovalue: null, view: { follow, veil, veilOpacity, slices, cross } });
  assert.deepEqual(readFragment("#veil=-300,7").view, { veil: -300 });
});

test("a broken address changes nothing", () => {
  for (const hash of ["", "#", "#view=1,2", "#view=1,2,x,4,5,6", "#view=0,0,-1,0,0,0", "#view=0,0,Infinity,0,0,0", "#veil=&budget=-3&follow=yes&cross=1,2&isovalue=x"]) {
    assert.deepEqual(readFragment(hash), { room: null, budgetMiB: null, volume: null, isovalue: null, view: {} }, hash);
  }
});

test("texts reach the page as text only", () => {
  const sources = readdirSync(join(pageFolder, "src"), { recursive: true, withFileTypes: true }).filter((entry) => entry.name.endsWith(".ts"));
  assert.ok(sources.length > 10);
  for (const entry of sources) {
    const text = readFileSync(join(entry.path, entry.name), "utf8");
    assert.doesNotMatch(text, /innerHTML|outerHTML|insertAdjacentHTML|document\.write|DOMParser|\beval\(|new Function|createContextualFragment/, entry.name);
  }
});
