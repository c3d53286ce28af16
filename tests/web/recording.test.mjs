// Recordings are MCAP files: the reader and the writer that others use understand ours, and we
// understand theirs. No browser.
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { test } from "node:test";

import { McapIndexedReader, McapStreamReader, McapWriter } from "@mcap/core";
import { decompress } from "fzstd";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor/index.js";

import { Room, runToEnd, sleep } from "./support.mjs";

const { env } = process;
const decompressHandlers = { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) };

const folder = mkdtempSync(path.join(tmpdir(), "palpate-mcap-"));
process.on("exit", () => rmSync(folder, { recursive: true }));

class Bytes {
  constructor(bytes) {
    this.bytes = bytes;
  }
  async size() {
    return BigInt(this.bytes.length);
  }
  async read(offset, size) {
    return this.bytes.subarray(Number(offset), Number(offset + size));
  }
}

async function record(t) {
  const room = new Room();
  t.after(() => room.end());
  const config = path.join(room.folder, "palpated.toml"), file = path.join(room.folder, "a.mcap");
  writeFileSync(config, `[volume]\nsave_folders = ["${room.folder}"]\n`);
  await room.startDaemon("builtin:bumps:48", "--config", config);
  await room.palpate("record", "start", file);
  await room.palpate("mark", "here: µ");
  await room.palpate("set", "isovalue", "0.4");
  await room.palpate("edit", "sphere", "--center-voxels", "24,24,24", "--radius-voxels", "5", "--operation", "set", "--value", "0.9");
  await sleep(2500);
  const state = JSON.parse(await room.palpate("record", "stop", "--json"));
  return [new Uint8Array(readFileSync(file)), state];
}

async function readIndexed(bytes) {
  const reader = await McapIndexedReader.Initialize({ readable: new Bytes(bytes), decompressHandlers });
  const messages = [];
  for await (const one of reader.readMessages({ validateCrcs: true })) messages.push(one);
  return { reader, messages };
}

function readStreamed(bytes) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(bytes);
  const messages = [];
  for (let record; (record = reader.nextRecord()); ) if (record.type === "Message") messages.push(record);
  assert.ok(reader.done());
  return messages;
}

function crc32(bytes) {
  let crc = -1;
  for (const byte of bytes) {
    crc ^= byte;
    for (let n = 0; n < 8; n++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc >>> 0;
}

// Of the data and of the summary: the reader does not check the first one.
function checkChecksums(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  let at = 8;
  while (bytes[at] !== 15) at += 9 + Number(view.getBigUint64(at + 1, true));
  assert.equal(view.getUint32(at + 9, true), crc32(bytes.subarray(0, at)));
  const footer = bytes.length - 8 - 20;
  const summary = Number(view.getBigUint64(footer, true));
  assert.equal(summary, at + 9 + 4);
  assert.equal(view.getUint32(footer + 16, true), crc32(bytes.subarray(summary, footer + 16)));
}

// By the schema in the file, as other programs do.
function decoderOf(schema) {
  const root = protobuf.Root.fromDescriptor(schema.data, { keepCase: true });
  const type = root.lookupType(schema.name);
  return (data) => type.toObject(type.decode(data), { longs: Number, enums: Number });
}

async function tableOf(bytes) {
  const file = path.join(folder, "of_table.mcap");
  writeFileSync(file, bytes);
  const [names, ...rows] = (await runToEnd(env.PALPATE_LAB, ["export", file])).trim().split("\n").map((line) => line.split(","));
  return rows.map((row) => Object.fromEntries(names.map((name, n) => [name, row[n]])));
}

const xyz = (v) => [v.x ?? 0, v.y ?? 0, v.z ?? 0];

test("others read every message of ours, indexed and streamed", async (t) => {
  const [bytes, state] = await record(t);
  checkChecksums(bytes);
  const { reader, messages } = await readIndexed(bytes);
  const topicOf = (one) => reader.channelsById.get(one.channelId).topic;
  const of = (topic) => messages.filter((one) => topicOf(one) === topic);
  assert.equal(of("/tick").length, state.ticks);
  assert.equal(Number(reader.statistics.messageCount), messages.length);
  const key = (one) => `${one.channelId} ${one.sequence} ${one.logTime} ${Buffer.from(one.data).toString("base64")}`;
  assert.deepEqual(readStreamed(bytes).map(key).sort(), messages.map(key).sort());
  for (const topic of ["/scene", "/voxels", "/keyframe", "/event", "/clock"]) assert.ok(of(topic).length > 0, topic);

  const decode = new Map([...reader.channelsById.values()].map((channel) => {
    assert.equal(channel.messageEncoding, "protobuf");
    return [channel.topic, decoderOf(reader.schemasById.get(channel.schemaId))];
  }));
  const rows = await tableOf(bytes);
  assert.equal(rows.length, state.ticks);
  of("/tick").forEach((message, n) => {
    const tick = decode.get("/tick")(message.data), row = rows[n];
    const vector = (name, unit) => ["x", "y", "z"].map((axis) => Number(row[`${name}_${axis}${unit}`]));
    assert.equal(String(message.logTime), row.unix_ns);
    assert.equal(tick.pose.tick, Number(row.tick));
    assert.equal(String(tick.pose.time_ns), row.time_ns);
    assert.deepEqual(xyz(tick.pose.hip_mm), vector("hip", "_mm"));
    assert.deepEqual(xyz(tick.pose.force_n), vector("force", "_n"));
    assert.equal(tick.pose.scp_h_normal !== undefined, row.contact === "1");
    assert.deepEqual(xyz(tick.pose.scp_h_mm), vector("scp_h", "_mm"));
    if (row.has_scp_v === "1") assert.deepEqual(xyz(tick.pose.scp_v_mm), vector("scp_v", "_mm"));
    for (const name of ["density", "isovalue", "buttons", "settings_revision", "volume_revision", "update_ns", "missed_ticks", "iterations", "capped_ticks"]) {
      assert.equal(tick.pose[name] ?? 0, Number(row[name]), name);
    }
    assert.equal(tick.faulty_ticks ?? 0, Number(row.faulty_ticks));
    assert.equal(tick.pose.forces.limit_n, Number(row.force_limit_n));
    assert.equal(tick.scene_revision, Number(row.scene_revision));
  });
  const event = decode.get("/event")(of("/event")[0].data);
  assert.equal(event.marker, "here: µ");
  assert.ok(rows.find((row) => Number(row.tick) === event.tick).markers.includes("µ"));
  const scene = decode.get("/scene")(of("/scene").at(-1).data);
  assert.equal(scene.settings.isovalue, 0.4);
  const metadata = new Map();
  for await (const one of reader.readMetadata()) metadata.set(one.name, one.metadata);
  assert.equal(metadata.get("palpate.end").get("ticks"), String(state.ticks));
});

test("we read what others write, in each way that they can", async (t) => {
  const [bytes] = await record(t);
  const { reader, messages } = await readIndexed(bytes);
  const expected = await tableOf(bytes);
  for (const options of [{}, { useChunks: false }, { useMessageIndex: false, useSummaryOffsets: false, useStatistics: false }]) {
    const parts = [];
    let size = 0n;
    const writable = {
      write: async (part) => {
        parts.push(part.slice());
        size += BigInt(part.length);
      },
      position: () => size,
    };
    const writer = new McapWriter({ writable, chunkSize: 100_000, ...options });
    await writer.start({ library: "@mcap/core", profile: "" });
    for await (const one of reader.readMetadata()) await writer.addMetadata(one);
    await writer.addAttachment({ name: "a", logTime: 0n, createTime: 0n, mediaType: "text/plain", data: new Uint8Array(50) });
    const ids = new Map();
    for (const channel of reader.channelsById.values()) {
      const schemaId = await writer.registerSchema(reader.schemasById.get(channel.schemaId));
      ids.set(channel.id, await writer.registerChannel({ ...channel, schemaId }));
    }
    for (const one of messages) await writer.addMessage({ ...one, channelId: ids.get(one.channelId) });
    await writer.end();
    assert.deepEqual(await tableOf(Buffer.concat(parts)), expected, JSON.stringify(options));
  }
});
