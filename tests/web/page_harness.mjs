// The page's modules in node, without a browser.
import { createRequire } from "node:module";
import { dirname, resolve } from "node:path";
import { fileURLToPath } from "node:url";

export const pageFolder = resolve(dirname(fileURLToPath(import.meta.url)), "../../client/web/page");
const require = createRequire(resolve(pageFolder, "package.json"));
const { build } = require("esbuild");
// Another implementation of protobuf than the page's, which reads the files of palpate/v1 themselves.
const protobuf = require("protobufjs");
const protos = new protobuf.Root();
protos.resolvePath = (_, path) => (path.startsWith("google/") ? require.resolve(`protobufjs/${path}`) : resolve(process.env.PALPATE_PROTOS, path));

// All that the files of `src` export, as one module.
export async function modules(...files) {
  const contents = files.map((file) => `export * from "./src/${file}";`).join("\n");
  const { outputFiles } = await build({
    stdin: { contents, resolveDir: pageFolder, loader: "ts" }, bundle: true, write: false, format: "esm", logLevel: "warning",
  });
  return import(`data:text/javascript;base64,${Buffer.from(outputFiles[0].text).toString("base64")}`);
}

const Envelope = protos.loadSync("palpate/v1/envelope.proto", { keepCase: true }).lookupType("palpate.v1.Envelope");

// The bytes of an Envelope, as a WebSocket gives them. Names are those of palpate/v1.
export function envelope(members) {
  const times = members.pose ? { sequence: 4_000_000_000, sent_ms: 13.5, age_ms: 0.75, fresh: true } : {};
  const bytes = Envelope.encode(Envelope.fromObject({ ...times, ...members })).finish();
  return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
}

export const somePose = {
  tick: 5, time_ns: 12_500_000, hip_mm: { x: 1, y: 2, z: 3 }, scp_h_mm: { x: 4, y: 5, z: 6 }, stylus_orientation: { w: 0.9, x: 0.1, y: 0.2, z: 0.3 },
  force_n: { x: 0, y: 0, z: 1.5 }, mode: 2, contact: true, density: 20.5, isovalue: 320, missed_ticks: 77, update_ns: 8250,
  forces: { state: 3, reason: 1, limit_n: 3.25 },
};

export function assertNear(assert, actual, expected, tolerance = 1e-6) {
  assert.equal(actual.length, expected.length);
  expected.forEach((value, n) => {
    assert.ok(Math.abs(actual[n] - value) <= tolerance * Math.max(1, Math.abs(value)), `${n}: ${actual[n]} is not ${value}`);
  });
}

// Random numbers below 1 that every run repeats.
export function random(seed) {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

// Lets all promises and timers of 0 ms that are due go on.
export const settle = async (turns = 20) => {
  for (let n = 0; n < turns; ++n) await new Promise((resume) => setTimeout(resume, 0));
};
