// The page draws the same surface as palpate-view: the two agree which pixels it covers, and how
// far it is.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { distancesOf } from "./distances.mjs";
import { Room, awaitPage, awaitWhole, dataFile, runToEnd } from "./support.mjs";

const SAME_VOXELS = 0.05;
const JUMP_VOXELS = 5;
// Of the pixels that are hit.
const MOST_OUTLINES = 0.001;

// The page's and the viewer's distances in mm of one view.
async function bothPictures(room, tab, view) {
  await tab.evaluate((wanted) => window.palpate.state.setView(wanted), view);
  await awaitPage(tab, "p.viewport.isFine()");
  const seen = await tab.evaluate(() => {
    const { state } = window.palpate;
    const canvas = document.querySelector("#viewport");
    const { azimuthDeg, elevationDeg, distanceMm, target } = state.view;
    return {
      size: [canvas.width, canvas.height],
      camera: [azimuthDeg, elevationDeg, distanceMm, ...target],
    };
  });
  const out = path.join(room.folder, "viewer.bin");
  const numbers = [...seen.size, ...seen.camera].map(String);
  await runToEnd(process.env.PALPATE_VIEW_DISTANCES, [room.socket, ...numbers, out]);
  const [width, height] = seen.size;
  const bytes = readFileSync(out);
  return {
    width,
    height,
    page: await distancesOf(tab, "palpate.viewport.caster"),
    viewer: new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + 4 * width * height)),
  };
}

// The viewer's distances within one pixel of (x, y).
function around(distances, width, height, x, y) {
  const found = [];
  for (let b = Math.max(0, y - 1); b <= Math.min(height - 1, y + 1); ++b) {
    for (let a = Math.max(0, x - 1); a <= Math.min(width - 1, x + 1); ++a) found.push(distances[b * width + a]);
  }
  return found;
}

// True at an outline of the viewer's picture, where the page's distance may be that of the other
// side: a ray that only just meets a part, or only just misses it.
function isOutline(near, distance, mmPerVoxel) {
  const [least, most] = [Math.min(...near), Math.max(...near)];
  const isJump = most - least > JUMP_VOXELS * mmPerVoxel;
  return isJump && distance >= least - mmPerVoxel && distance <= most + mmPerVoxel;
}

// `mmPerVoxel`: the shortest edge of a voxel.
function compare({ width, height, page, viewer }, mmPerVoxel) {
  assert.equal(page.length, width * height);
  const result = { hits: 0, worst: 0, apart: 0, outlines: 0 };
  for (let y = 0; y < height; ++y) {
    for (let x = 0; x < width; ++x) {
      const a = page[y * width + x];
      const b = viewer[y * width + x];
      if (!Number.isFinite(a) && !Number.isFinite(b)) continue;
      const off = Math.abs(a - b) / mmPerVoxel;
      if (off <= SAME_VOXELS) {
        ++result.hits;
        result.worst = Math.max(result.worst, off);
      } else if (isOutline(around(viewer, width, height, x, y), a, mmPerVoxel)) {
        ++result.outlines;
      } else {
        ++result.apart;
      }
    }
  }
  return result;
}

async function voxelEdge(tab) {
  const map = await tab.evaluate(() => window.palpate.state.placement.deviceFromIndex);
  const edges = [0, 1, 2].map((axis) => Math.hypot(map[axis], map[axis + 4], map[axis + 8]));
  return Math.min(...edges);
}

const CASES = [
  ["the CT head", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd"],
  ["the lobster", "paper/lobster_301x324x56_uint8.nhdr"],
];

for (const [name, file] of CASES) {
  const volume = dataFile(file);
  test(`${name} looks as in palpate-view`, { skip: volume ? false : `no ${file}` }, async (t) => {
    const room = new Room();
    t.after(() => room.end());
    await room.startDaemon(volume);
    await room.startGateway();
    const tab = await room.openBrowser({ width: 900, height: 420 });
    await awaitWhole(tab);
    const edge = await voxelEdge(tab);
    for (const view of [{ azimuthDeg: 30, elevationDeg: 20 }, { azimuthDeg: -100, elevationDeg: -35 }]) {
      const result = compare(await bothPictures(room, tab, view), edge);
      t.diagnostic(`${name}: ${JSON.stringify(result)}`);
      assert.ok(result.hits > 2000, "the surface is seen");
      assert.equal(result.apart, 0, "the same depths, and outlines within one pixel");
      assert.ok(result.outlines <= MOST_OUTLINES * result.hits, `${result.outlines} pixels at outlines differ`);
    }
    assert.deepEqual(tab.problems, []);
  });
}
