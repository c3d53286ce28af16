// Poses, facts, the manifest, and the page's copy of the volume.
import assert from "node:assert/strict";
import { test } from "node:test";

import { assertNear, envelope, modules, random, settle, somePose } from "./page_harness.mjs";

const page = await modules("wire/contract.ts", "state.ts", "volume/manifest.ts", "volume/overview_voxels.ts", "volume/copy.ts", "wire/meanwhile.ts", "ui/badge.ts");
const { decode, isFreeAbove, memberOf, State, parseManifest, groupCounts, groupNumber, groupPlace, OverviewVoxels, VolumeCopy, Meanwhile, badgeOf } = page;

const poseOf = (members = {}) => decode(envelope({ pose: { ...somePose, ...members } })).pose;

test("a pose is read from its bytes", () => {
  const pose = poseOf({ tick: 2 ** 40 + 1, isovalue: -300.5, free_side: 2 });
  assert.deepEqual([pose.sequence, pose.sentMs, pose.ageMs, pose.fresh], [4_000_000_000, 13.5, 0.75, true]);
  assert.deepEqual([pose.tick, pose.timeNs, pose.isovalue, pose.missedTicks], [2 ** 40 + 1, 12_500_000, -300.5, 77]);
  assert.deepEqual([pose.hipMm, pose.scpHMm, pose.scpVMm, pose.forceN], [[1, 2, 3], [4, 5, 6], undefined, [0, 0, 1.5]]);
  assert.deepEqual([pose.stylusOrientation, pose.forces.limitN, isFreeAbove(pose)], [[0.1, 0.2, 0.3, 0.9], 3.25, true]);
  assert.ok(Number.isNaN(decode(envelope({ pose: somePose, age_ms: undefined })).pose.ageMs));
});

test("a field that this page does not know is no obstacle, and bytes that are no message are ignored", () => {
  assert.equal(decode(new ArrayBuffer(5)), null);
  assert.equal(decode(Uint8Array.of(0xff, 0xff).buffer), null);
  assert.equal(decode(envelope({ pose: { tick: 5 } })), null); // no place
  const known = new Uint8Array(envelope({ pose: somePose }));
  assert.equal(decode(Uint8Array.of(...known, 0xa2, 0x3e, 1, 7).buffer).pose.missedTicks, 77); // field 996
});

test("facts are read from their bytes, one in each message", () => {
  const { fact } = decode(envelope({ facts: { settings: { settings: { isovalue: 3, stiffness_n_per_mm: 0.5, free_side: 2 }, settings_revision: 4 } } }));
  assert.deepEqual(Object.keys(fact), ["settings"]);
  const state = new State();
  state.receiveFact(fact);
  assert.deepEqual(["isovalue", "stiffness_n_per_mm", "free_side", "method"].map((key) => state.setting(key)), [3, 0.5, 2, undefined]);
  assert.equal(memberOf("damping_n_s_per_m"), "dampingNSPerM");
  const linear = [1, 0, 0, 0, 2, 0, 0, 0, 3];
  const volume = { name: "head.nrrd", size_x: 4, size_y: 5, size_z: 6, voxel_type: "VOXEL_TYPE_INT16", world_from_index: { linear, translation: { x: 7, y: 8, z: 9 } } };
  state.receiveFact(decode(envelope({ facts: { volume } })).fact);
  assert.deepEqual([state.volume.size, state.volume.type, state.volume.worldFromIndex], [[4, 5, 6], "int16", [1, 0, 0, 7, 0, 2, 0, 8, 0, 0, 3, 9]]);
  state.receiveFact(decode(envelope({ facts: { volume: {} } })).fact);
  assert.equal(state.volume, null);
  assert.equal(state.settings.settings.isovalue, 3); // the others stay
});

test("a pose's age counts from the shortest way seen", () => {
  const state = new State();
  const now = performance.now();
  state.receivePose({ ...poseOf(), sentMs: now - 1000, ageMs: 5 });
  assert.ok(state.poseAgeMs() < 900);
  state.receivePose({ ...poseOf(), sentMs: now - 3000, ageMs: 5 }); // 2 s late
  assert.ok(state.poseAgeMs() >= 2005);
  state.receivePose({ ...poseOf(), sentMs: now - 1000, ageMs: NaN });
  assert.ok(state.poseAgeMs() < 2000);
});

test("groups are numbered along the last axis first", () => {
  const counts = groupCounts([33, 64, 100]);
  assert.deepEqual(counts, [2, 2, 4]);
  let number = 0;
  for (let a = 0; a < 2; ++a) {
    for (let b = 0; b < 2; ++b) {
      for (let c = 0; c < 4; ++c, ++number) {
        assert.equal(groupNumber(counts, a, b, c), number);
        assert.deepEqual(groupPlace(counts, number), [a, b, c]);
      }
    }
  }
});

test("the overview is exact for values that rise evenly, within the centres of its blocks", () => {
  const [size, factor] = [[5, 6, 7], 4];
  const rising = (i, j, k) => 3 * i - 2 * j + 0.5 * k + 100;
  const blocks = new Float32Array(5 * 6 * 7);
  const centre = (n) => factor * n + (factor - 1) / 2;
  for (let n = 0; n < blocks.length; ++n) {
    blocks[n] = rising(centre(Math.floor(n / 42)), centre(Math.floor(n / 7) % 6), centre(n % 7));
  }
  const overview = new OverviewVoxels({ size, factor, type: "float32" }, blocks);
  const group = overview.group({ size: [20, 23, 28], type: "float32", background: -1, valueMin: 0, valueMax: 1 }, [0, 0, 0]);
  for (const [i, j, k] of [[2, 2, 2], [17, 20, 25], [9, 4, 13]]) {
    assertNear(assert, [overview.at(i, j, k), group[1024 * i + 32 * j + k]], [rising(i, j, k), rising(i, j, k)]);
  }
  assert.equal(group[1024 * 20], -1); // beyond the lattice
});

// A gateway: blobs by name, and a manifest of random voxels.
class Gateway {
  blobs = new Map();
  requests = 0;
  failures = () => 200;

  constructor(size, seed) {
    this.size = size;
    this.next = random(seed);
    this.counts = groupCounts(size);
    this.groups = Array.from({ length: this.counts[0] * this.counts[1] * this.counts[2] }, () => this.newGroup());
    globalThis.fetch = async (url) => {
      ++this.requests;
      await settle(Math.floor(3 * this.next()));
      const names = url.slice("volume/".length).split(",");
      const status = names.every((name) => this.blobs.has(name)) ? this.failures() : 410;
      return new Response(status === 200 ? new Blob(names.map((name) => this.blobs.get(name))) : "", { status });
    };
  }

  put(bytes) {
    const name = Array.from({ length: 32 }, () => Math.floor(16 * this.next()).toString(16)).join("");
    this.blobs.set(name, bytes);
    return name;
  }

  newGroup() {
    const value = Math.floor(4 * this.next());
    return value === 0 ? "" : this.put(new Uint8Array(32 ** 3).fill(value + 10 * Math.floor(20 * this.next())));
  }

  // Replaces some groups; what they replace is gone.
  edit() {
    for (let n = 0; n < 3; ++n) {
      const at = Math.floor(this.groups.length * this.next());
      this.blobs.delete(this.groups[at]);
      this.groups[at] = this.newGroup();
    }
  }

  valueOf(number) {
    return this.groups[number] === "" ? 0 : this.blobs.get(this.groups[number])[0];
  }

  manifest(revision, { withGroups = true } = {}) {
    const blocks = this.size.map((n) => Math.ceil(n / 32));
    const overview = new Uint8Array(blocks[0] * blocks[1] * blocks[2]).map((_, n) => this.valueOf(n));
    const groups = Buffer.from(this.groups.map((name) => name || "0".repeat(32)).join(""), "hex").toString("base64");
    return {
      type: "manifest", revision, complete: true,
      name: this.put(JSON.stringify({
        lattice: { size: this.size, voxel_type: "uint8", background: 0, value_min: 0, value_max: 255, factor: 1 },
        revision, daemon_id: "d", content_hash: String(revision).padStart(32, "0"),
        overview: { name: this.put(overview), size: blocks, factor: 32 }, groups: withGroups ? groups : "",
      })),
    };
  }
}

function valuesOf(copy, counts) {
  return Array.from({ length: counts[0] * counts[1] * counts[2] }, (_, number) => copy.value(...groupPlace(counts, number).map((n) => 32 * n)));
}

const shownOf = (copy, revision) => new Promise((resume) => copy.state.on("copyShown", () => copy.revision >= revision && resume()));

test("a manifest that lacks groups is refused", () => {
  const gateway = new Gateway([64, 64, 64], 1);
  const text = gateway.blobs.get(gateway.manifest(1).name);
  assert.equal(parseManifest("n", text).groups.length, 8);
  const json = JSON.parse(text);
  json.groups = json.groups.slice(0, 40);
  assert.throws(() => parseManifest("n", JSON.stringify(json)));
});

test("the copy shows whole manifests only, while groups are replaced and vanish", async () => {
  const gateway = new Gateway([90, 100, 130], 2);
  const state = new State();
  const copy = new VolumeCopy(state);
  const expected = new Map();
  let shown = 0;
  state.on("copyShown", () => {
    ++shown;
    assert.equal(copy.contentHash, String(copy.revision).padStart(32, "0"));
    assert.deepEqual(valuesOf(copy, gateway.counts), expected.get(copy.revision));
  });
  const last = 60;
  const whole = shownOf(copy, last);
  for (let revision = 1; revision <= last; ++revision) {
    gateway.edit();
    expected.set(revision, gateway.groups.map((_, number) => gateway.valueOf(number)));
    state.receive(gateway.manifest(revision));
    await settle(Math.floor(12 * gateway.next()));
  }
  await whole;
  assert.ok(shown > 1);
  assert.equal(copy.groupsLeft, 0);
});

test("equal groups are fetched once, and known ones not again", async () => {
  const gateway = new Gateway([64, 64, 64], 3);
  const one = gateway.put(new Uint8Array(32 ** 3).fill(9));
  gateway.groups.fill(one);
  const state = new State();
  const copy = new VolumeCopy(state);
  const first = shownOf(copy, 1);
  state.receive(gateway.manifest(1));
  await first;
  assert.equal(gateway.requests, 3); // manifest, overview, group
  const second = shownOf(copy, 2);
  gateway.groups[3] = "";
  state.receive(gateway.manifest(2));
  await second;
  assert.equal(gateway.requests, 4);
  assert.equal(copy.value(0, 40, 40), 0);
  assert.equal(copy.value(0, 40, 0), 9);
});

test("while a volume comes, the overview stands for what is missing", async () => {
  const gateway = new Gateway([17 * 32, 32, 32], 4); // 16 groups come in one answer
  gateway.groups = gateway.groups.map((_, n) => gateway.put(new Uint8Array(32 ** 3).fill(n < 16 ? 100 : 200)));
  const missing = gateway.groups[16];
  let come;
  const comes = new Promise((resume) => (come = resume));
  const serve = globalThis.fetch;
  globalThis.fetch = async (url) => {
    if (url.endsWith(missing)) await comes;
    return serve(url);
  };
  const state = new State();
  const copy = new VolumeCopy(state);
  const whole = shownOf(copy, 1);
  state.receive(gateway.manifest(1));
  while (copy.groupsLeft !== 1) await settle(1);
  await settle();
  assert.equal(copy.isOverview, false);
  assert.equal(copy.contentHash, "");
  assert.equal(copy.value(528, 0, 0), 200);
  assert.ok(copy.value(520, 0, 0) > 150 && copy.value(520, 0, 0) < 200);
  come();
  await whole;
  assert.equal(copy.value(520, 0, 0), 200);
});

test("the overview alone is shown if the gateway gives no groups, or the volume exceeds the budget", async () => {
  for (const [options, budget] of [[{ withGroups: false }, 1024], [{}, 0.001]]) {
    const gateway = new Gateway([64, 96, 64], 5);
    const state = new State();
    const copy = new VolumeCopy(state, budget);
    const whole = shownOf(copy, 1);
    state.receive(gateway.manifest(1, options));
    await whole;
    assert.ok(copy.isOverview && copy.whyOverview !== "");
    assert.deepEqual([copy.factor, copy.shape.size, gateway.requests], [32, [2, 3, 2], 2]);
    assert.equal(copy.value(1, 2, 0), gateway.valueOf(groupNumber([2, 3, 2], 1, 2, 0)));
    assert.deepEqual([...copy.plane(1, 2).values], [0, 1, 2, 3].map((n) => gateway.valueOf(groupNumber([2, 3, 2], n % 2, 2, n >> 1))));
  }
});

// The last one with groups: the page remembers it.
test("where several blobs cannot come in one answer, they come one by one", async () => {
  const gateway = new Gateway([64, 64, 64], 6);
  const serve = globalThis.fetch;
  globalThis.fetch = async (url) => (url.includes(",") ? new Response("", { status: 406 }) : serve(url));
  const state = new State();
  const copy = new VolumeCopy(state);
  const whole = shownOf(copy, 1);
  state.receive(gateway.manifest(1));
  await whole;
  assert.deepEqual(valuesOf(copy, gateway.counts), gateway.groups.map((_, number) => gateway.valueOf(number)));
});

test("without its volume a room is not live, and the badge says what is missing", () => {
  const state = Object.assign(new State(), { link: "open", connection: { state: "connected" } });
  state.receivePose({ ...poseOf(), sentMs: performance.now(), ageMs: 0 });
  const words = [];
  for (const told of [{}, { volume: { name: "head.nrrd" } }, { copy: { problem: "40 %", loading: true } }, { copy: { problem: "NATS is not reached" } }]) {
    words.push(badgeOf(Object.assign(state, told)).words);
  }
  assert.deepEqual(words.map((one) => one === "live"), [false, true, false, false]);
  assert.match(words[2], /loads.*40 %/);
  assert.match(words[3], /NATS/);
});

test("what happened meanwhile is said", () => {
  const state = new State();
  new Meanwhile(state);
  const volume = (name) => state.receiveFact({ volume: { name, size: [2, 2, 2] } });
  const link = (value) => { state.link = value; state.emit("link"); };
  const connection = (value) => state.receive({ type: "connection", state: value, why: value === "lost" ? "palpated is not reached" : "" });
  const pose = (tick, isovalue) => state.receivePose(poseOf({ tick, isovalue }));
  const settings = (isovalue) => state.receiveFact({ settings: { settings: { isovalue } } });
  link("open"); connection("connected"); volume("head.nrrd"); settings(10); pose(1000, 10);
  assert.deepEqual(state.events, []);
  connection("lost"); connection("connected"); pose(1010, 10);
  assert.equal(state.events.length, 1);
  assert.match(state.events[0], /^palpated/);
  link("lost"); link("open"); connection("connected"); pose(5, 0); // palpated has no volume yet
  state.receiveFact({ volume: null }); settings(0); pose(6, 0);
  assert.doesNotMatch(state.events.join(), /isovalue/);
  settings(12.7); pose(7, 0); volume("<b>lobster.nrrd"); pose(8, 0); pose(9, 12.7);
  const told = state.events.slice(1).join("\n");
  for (const word of [/lost for \d+ s/, /restarted/, /10 to 12\.7/, /<b>lobster\.nrrd/]) assert.match(told, word);
  settings(20); pose(10, 20); // not meanwhile
  assert.equal(state.events.length, 5);
});
