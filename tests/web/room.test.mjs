// Guests in a room: the page's copy is the daemon's volume, and the page comes back by itself.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createConnection, createServer } from "node:net";
import path from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

import { Room, awaitPage, awaitWhole, freePort, run, runToEnd, sleep, until } from "./support.mjs";

const TYPES = { uint8: "u1", int16: "<i2", uint16: "<u2", float32: "<f4" };
const HASH = fileURLToPath(new URL("content_hash.py", import.meta.url));
const EDITS = fileURLToPath(new URL("edits.py", import.meta.url));

function contentHash({ type, size, voxels }) {
  return new Promise((done, fail) => {
    const program = spawn(process.env.PALPATE_PYTHON, [HASH, TYPES[type], ...size.map(String)]);
    let text = "";
    program.stdout.on("data", (part) => (text += part));
    program.stderr.on("data", (part) => (text += part));
    program.on("exit", (code) => (code === 0 ? done(text.trim()) : fail(new Error(text))));
    program.stdin.end(voxels);
  });
}

// Keeps the voxels of every manifest that the page shows from now on.
function keepCopies(tab) {
  return tab.evaluate(() => {
    const { copy, state } = window.palpate;
    window.kept = [];
    const keep = () => {
      const [ni, nj, nk] = copy.shape.size;
      const kinds = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, float32: Float32Array };
      const voxels = new kinds[copy.shape.type](ni * nj * nk);
      let n = 0;
      for (let i = 0; i < ni; ++i) {
        for (let j = 0; j < nj; ++j) for (let k = 0; k < nk; ++k) voxels[n++] = copy.value(i, j, k);
      }
      window.kept.push({
        revision: copy.revision, hash: copy.contentHash, type: copy.shape.type,
        size: copy.shape.size, voxels,
      });
    };
    state.on("copyShown", keep);
    keep();
  });
}

async function keptCopies(tab) {
  const kept = await tab.evaluate(() =>
    window.kept.map(({ voxels, ...rest }) => {
      const bytes = new Uint8Array(voxels.buffer);
      let text = "";
      for (let n = 0; n < bytes.length; n += 8192) text += String.fromCharCode(...bytes.subarray(n, n + 8192));
      return { ...rest, voxels: btoa(text) };
    }),
  );
  return kept.map((one) => ({ ...one, voxels: Buffer.from(one.voxels, "base64") }));
}

test("the copy equals the daemon's volume at each manifest that is shown", async (t) => {
  const room = new Room();
  t.after(() => room.end());
  await room.startDaemon("builtin:gyroid:72");
  await room.startGateway();
  const tab = await room.openBrowser({ width: 500, height: 400 });
  await awaitWhole(tab);
  await keepCopies(tab);
  let kept = [];
  while (kept.length <= 5) { // a slow machine shows few of many
    await runToEnd(process.env.PALPATE_PYTHON, [EDITS, room.socket, "80", "20"]);
    const info = JSON.parse(await room.palpate("info", "--json"));
    await awaitPage(tab, `p.copy.revision === ${info.volume.volume_revision}`);
    kept = await keptCopies(tab);
  }
  for (const copy of kept) assert.equal(await contentHash(copy), copy.hash, `revision ${copy.revision}`);
  t.diagnostic(`${kept.length} manifests shown, all equal`);
});

const events = (tab) => tab.evaluate(() => window.palpate.state.events.join("\n"));
const revisionOfSettings = (tab) => tab.evaluate(() => window.palpate.state.settings.settingsRevision);
const awaitLive = (tab) =>
  awaitPage(tab, "p.state.link === 'open' && p.state.connection?.state === 'connected' && p.state.pose?.fresh");

// A room with a guest whose page is not to be loaded again.
async function watchedRoom(t) {
  const room = new Room();
  t.after(() => room.end());
  await room.startDaemon("builtin:bumps:48");
  await room.startGateway();
  const tab = await room.openBrowser({ width: 500, height: 400 });
  await awaitWhole(tab);
  await tab.evaluate(() => (window.isTheSamePage = true));
  return [room, tab];
}

test("the gateway is killed and comes back: the page follows without a reload", async (t) => {
  const [room, tab] = await watchedRoom(t);
  await room.gateway.end("SIGKILL");
  await awaitPage(tab, "p.state.link === 'lost'");
  await room.palpate("set", "isovalue", "0.3");
  await room.startGateway();
  await awaitLive(tab);
  await awaitPage(tab, "Math.abs(p.state.settings.settings.isovalue - 0.3) < 1e-6");
  assert.equal(await tab.evaluate(() => window.isTheSamePage), true);
  assert.match(await events(tab), /lost/i);
  assert.match(await events(tab), /isovalue/i);
});

test("palpated is killed and comes back with another volume: the page says so and shows it", async (t) => {
  const [room, tab] = await watchedRoom(t);
  await room.daemon.end("SIGKILL");
  await awaitPage(tab, "p.state.connection.state === 'lost'");
  assert.equal(await tab.evaluate(() => window.palpate.state.link), "open");
  await room.startDaemon("builtin:sphere:40");
  await awaitLive(tab);
  await awaitPage(tab, "p.copy.shape.size[0] === 40 && p.copy.groupsLeft === 0");
  assert.equal(await tab.evaluate(() => window.isTheSamePage), true);
  assert.match(await events(tab), /palpated/i);
});

test("guests are told of a replay, but not who replays what", async (t) => {
  const room = new Room();
  t.after(() => room.end());
  await room.startDaemon("builtin:bumps:48", "--save-folder", room.folder);
  await room.startGateway();
  const tab = await room.openBrowser({ width: 900, height: 600 });
  await awaitWhole(tab);
  const file = path.join(room.folder, "patient-7.mcap");
  await room.palpate("record", "run", file, "--seconds", "1");
  const replay = run(process.env.PALPATE, ["replay", file, "--speed", "0.001", "--socket", room.socket]);
  t.after(() => replay.end());
  const says = (words) => awaitPage(tab, `document.body.innerText.includes("${words}")`);
  await says("replay: forces are off until");
  assert.match(await room.palpate("info"), /replay of patient-7.mcap by local socket: forces are off/);
  const seen = await tab.evaluate(() => document.body.innerText +
    JSON.stringify(window.palpate.state, (_, value) => (typeof value === "bigint" ? `${value}` : value)));
  assert.doesNotMatch(seen, /patient-7|local socket/);
  await replay.end("SIGINT");
  await says("live");
  await awaitPage(tab, "!p.state.pose.replayed");
});

// Forwards a port, until it is frozen: then nothing passes and nothing is refused, as when a cable
// is pulled.
class Cable {
  async begin(to) {
    this.sockets = new Set();
    this.frozen = false;
    this.port = await freePort();
    this.server = createServer((near) => {
      const far = createConnection(to, "127.0.0.1");
      for (const [one, other] of [[near, far], [far, near]]) {
        this.sockets.add(one);
        one.on("data", (bytes) => this.frozen || other.write(bytes));
        one.on("close", () => this.frozen || other.destroy()).on("error", () => {});
      }
    });
    await new Promise((done) => this.server.listen(this.port, "127.0.0.1", done));
  }
  end() {
    for (const socket of this.sockets) socket.destroy();
    this.server.close();
  }
}

test("the network is gone for 10 s: the page says it is old, and comes back", async (t) => {
  const room = new Room();
  const cable = new Cable();
  t.after(async () => {
    cable.end();
    await room.end();
  });
  await room.startDaemon("builtin:bumps:48");
  room.port = await freePort();
  await cable.begin(room.port);
  await room.startGateway("", "--public-url", `http://localhost:${cable.port}`);
  const tab = await room.openBrowser({ width: 500, height: 400 });
  await awaitWhole(tab);
  await tab.evaluate(() => (window.isTheSamePage = true));
  cable.frozen = true;
  await awaitPage(tab, "p.state.link === 'lost' || p.state.poseAgeMs() > 3000");
  await sleep(10_000);
  await room.palpate("set", "isovalue", "0.35");
  cable.frozen = false;
  await awaitLive(tab);
  await awaitPage(tab, "Math.abs(p.state.settings.settings.isovalue - 0.35) < 1e-6 && p.state.poseAgeMs() < 2000");
  assert.equal(await tab.evaluate(() => window.isTheSamePage), true);
  assert.match(await events(tab), /lost/i);
});

async function newUser(room, name, ...keys) {
  const text = await runToEnd(process.env.PALPATE_WEB, [
    "user", name, ...keys.flatMap((key) => ["--may-steer", key]),
  ]);
  const lines = text.slice(text.indexOf("[[user]]"));
  const token = /again: (\S+)/.exec(text)[1];
  return { token, lines };
}

test("a named user steers the isovalue, everyone sees who did; a guest cannot", async (t) => {
  const room = new Room();
  t.after(() => room.end());
  await room.startDaemon("builtin:bumps:48");
  const lecturer = await newUser(room, "lecturer-1", "isovalue");
  const link = await room.startGateway(lecturer.lines);
  const guest = await room.openBrowser({ width: 500, height: 400 });
  await awaitLive(guest);
  const steerer = await room.openBrowser({ width: 500, height: 400, link: link.split("#")[0] });
  await awaitPage(steerer, "p.state.link === 'login'");
  await steerer.evaluate((token) => window.palpate.room.login({ token }), lecturer.token);
  await awaitLive(steerer);
  assert.deepEqual(await steerer.evaluate(() => window.palpate.state.hello.may_steer), ["isovalue"]);
  const before = await revisionOfSettings(guest);
  const refused = await guest.evaluate(() => window.palpate.room.steer("isovalue", 0.4).then(() => "", (error) => String(error)));
  assert.notEqual(refused, "");
  assert.equal(await revisionOfSettings(guest), before);
  // A browser that stood for seconds has lost its connection, and comes back.
  await until("the isovalue is taken", async () => {
    await awaitLive(steerer);
    return steerer.evaluate(() => window.palpate.room.steer("isovalue", 0.4).then(() => true, () => false));
  });
  await awaitPage(guest, "Math.abs(p.state.settings.settings.isovalue - 0.4) < 1e-6");
  await awaitPage(guest, "p.state.steering.changes.at(-1)?.user === 'lecturer-1'");
  await awaitPage(guest, "p.state.events.some((text) => text.includes('lecturer-1'))");
  await until("a log line with the user", () => /lecturer-1/.test(room.gateway.output));
});

test("with --no-volume only the overview leaves the gateway", async (t) => {
  const room = new Room();
  t.after(() => room.end());
  await room.startDaemon("builtin:bumps:48");
  await room.startGateway("", "--no-volume");
  const tab = await room.openBrowser({ width: 500, height: 400 });
  await awaitLive(tab);
  await awaitPage(tab, "p.copy.shape && p.copy.isOverview");
  const manifest = await tab.evaluate(async () => {
    const answer = await fetch(`volume/${window.palpate.state.manifest.name}`);
    return answer.json();
  });
  assert.equal(manifest.groups, "");
  assert.deepEqual(manifest.overview.size, [12, 12, 12]);
});
