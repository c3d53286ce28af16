// How soon a guest sees something, and what the page holds in memory. Judged by the clock: run alone.
import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { Room, awaitPage } from "./support.mjs";

// A rough ball in noise of uint8: no group has one value.
function writeBall(file, edge) {
  const voxels = Buffer.alloc(edge ** 3);
  const middle = (edge - 1) / 2;
  let seed = 1;
  let n = 0;
  for (let i = 0; i < edge; ++i) {
    for (let j = 0; j < edge; ++j) {
      for (let k = 0; k < edge; ++k) {
        seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
        const noise = seed >>> 27;
        const r = Math.hypot(i - middle, j - middle, k - middle) / middle;
        voxels[n++] = noise + (r < 0.8 + 0.02 * Math.sin(20 * r + 0.2 * i) ? 150 : 0);
      }
    }
  }
  const header = `NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${edge} ${edge} ${edge}\nencoding: raw\n\n`;
  writeFileSync(file, Buffer.concat([Buffer.from(header), voxels]));
}

// Marks in the page when the first pictures of the overview and of the whole volume are there.
function markPictures() {
  let palpate;
  Object.defineProperty(window, "palpate", {
    get: () => palpate,
    set(made) {
      palpate = made;
      const { state, copy, viewport } = made;
      state.on("picture", () => {
        const isOverview = copy.contentHash === "" && (!viewport.first.canvas.hidden || viewport.caster.shown !== null);
        if (!isOverview && !viewport.caster.isCurrent) return;
        const name = isOverview ? "palpate-overview" : "palpate-volume";
        if (performance.getEntriesByName(name).length === 0) performance.mark(name);
      });
    },
  });
}

// Shares of one run, since machines differ: how much sooner than the volume the overview comes.
const CASES = [
  { edge: 256, overviewShare: 1 / 2 },
  { edge: 512, overviewShare: 1 / 4 },
];
// Eight times the voxels take at most half of eight times as long.
const VOLUME_GROWTH = 4;
const volumesMs = [];

for (const { edge, overviewShare } of CASES) {
  test(`${edge}³ uint8: first the overview, then the volume`, async (t) => {
    const room = new Room();
    t.after(() => room.end());
    const file = path.join(room.folder, "ball.nrrd");
    writeBall(file, edge);
    await room.startDaemon(file, "--isovalue", "100");
    await room.startGateway();
    // The gateway has its copy before a guest comes.
    const first = await room.openBrowser();
    await awaitPage(first, "p.copy.revision > 0");
    await first.browser().close();
    const tab = await room.openBrowser({ first: markPictures });
    await awaitPage(tab, "performance.getEntriesByName('palpate-volume').length > 0");
    const seen = await tab.evaluate(() => {
      const at = (name) => performance.getEntriesByName(name)[0]?.startTime;
      const [navigation] = performance.getEntriesByType("navigation");
      return {
        loadedMs: navigation.loadEventEnd,
        overviewMs: at("palpate-overview") - navigation.loadEventEnd,
        volumeMs: at("palpate-volume") - navigation.loadEventEnd,
        voxelsMiB: window.palpate.copy.memoryBytes / 2 ** 20,
        heapMiB: performance.memory?.usedJSHeapSize / 2 ** 20,
      };
    });
    t.diagnostic(`${edge}³: ${JSON.stringify(seen)}`);
    assert.ok(seen.overviewMs <= overviewShare * seen.volumeMs, "the overview came late");
    volumesMs.push(seen.volumeMs);
  });
}

test("a larger volume takes no more than its share", () => {
  assert.equal(volumesMs.length, CASES.length);
  assert.ok(volumesMs[1] <= VOLUME_GROWTH * volumesMs[0]);
});
