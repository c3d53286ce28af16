// The page's interface in a browser, fed by hand: a State, a Room that remembers its calls, and a volume
// that is a ball. It is served with the gateway's Content-Security-Policy.
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { readFile } from "node:fs/promises";
import { dirname, resolve } from "node:path";
import { fileURLToPath } from "node:url";

export const pageFolder = resolve(dirname(fileURLToPath(import.meta.url)), "../../client/web/page");
const require = createRequire(resolve(pageFolder, "package.json"));
const { build } = require("esbuild");
export const puppeteer = require("puppeteer-core");
const axe = require("axe-core");

const kEntry = `
import { State } from "./src/state";
import { buildInterface } from "./src/ui/index";

const kSize = [64, 56, 48];
const ball = (i, j, k) => 1000 - 40 * Math.hypot(i - 30, j - 28, k - 24);
const copy = {
  shape: null, factor: 1, groupsLeft: 0, groupsAll: 8, groupBytes: 65536, fetching: { sinceMs: 0, groups: 8 }, revision: 1, contentHash: "", isOverview: false, whyOverview: "",
  memoryBytes: 0, groups: () => [],
  value: ball,
  plane(axis, index) {
    const [a, b] = [0, 1, 2].filter((n) => n !== axis);
    const values = new Float32Array(kSize[a] * kSize[b]);
    for (let y = 0; y < kSize[b]; ++y) {
      for (let x = 0; x < kSize[a]; ++x) {
        const at = [0, 0, 0];
        at[axis] = index; at[a] = x; at[b] = y;
        values[y * kSize[a] + x] = ball(...at);
      }
    }
    return { width: kSize[a], height: kSize[b], values };
  },
};
const state = new State();
const calls = [];
const room = {
  roomKey: null,
  refusal: "",
  async login(secret) {
    calls.push({ what: "login", secret });
    if (room.refusal) throw new Error(room.refusal);
    state.link = "open";
    state.emit("link");
  },
  async steer(key, value) {
    calls.push({ what: "steer", key, value, atMs: performance.now() });
    if (room.refusal) throw new Error(room.refusal);
  },
};
const actions = {
  resetView: () => calls.push({ what: "reset" }),
  savePng: () => calls.push({ what: "png" }),
  shareLink: () => location.origin + "/#room=KEY&view=1",
};
buildInterface(state, room, copy, actions);

const kIsovalue = { key: "isovalue", label: "Isovalue", unit: "HU", help: "the surface is where the volume has this value", kind: "number", minimum: null, maximum: null, words: [] };
const kOthers = [
  { key: "stiffness_n_per_mm", label: "Stiffness", unit: "N/mm", help: "force for each mm of penetration", kind: "number", minimum: 0.05, maximum: 2, words: [] },
  { key: "friction", label: "Friction", unit: "", help: "the proxy sticks and slides on the surface", kind: "flag", minimum: null, maximum: null, words: [] },
  { key: "method", label: "Method", unit: "", help: "how the proxy moves", kind: "choice", minimum: null, maximum: null, words: ["tetrahedra", "trilinear"] },
];
function receive(type, members) { state.receive({ type, ...members }); }
const fact = (name, members) => state.receiveFact({ [name]: members });
function connect({ mayFeel = [], mayStop = true, name = "head_ct_256.nrrd", axes = "LPS", answered = false } = {}) {
  state.link = "open";
  state.emit("link");
  receive("hello", { protocol: 1, version: "0.9.0", user: mayFeel.length ? "lecturer-1" : "guest-12", may_steer: mayFeel, may_stop: mayStop, settings: [kIsovalue, ...kOthers], server_time_ms: 0 });
  receive("connection", { state: "connected", why: "", palpated: "theatre-2", since_ms: 0 });
  copy.shape = { size: kSize, type: "int16", background: -1000, valueMin: -1000, valueMax: 1000 };
  const counts = Array.from({ length: 128 }, (_, n) => Math.round(90000 * Math.exp(-(((n - 20) / 9) ** 2)) + 30000 * Math.exp(-(((n - 66) / 6) ** 2)) + 6000 * Math.exp(-n / 60)));
  fact("volume", { name, size: kSize, type: "int16", valueMin: -1000, valueMax: 1000, unit: "HU", windowLevel: 0, windowWidth: 0,
    worldFromIndex: [1, 0, 0, -32, 0, 1, 0, -28, 0, 0, 1, -24], histogram: { low: -1000, high: 1000, counts },
    suggestedIsovalues: [{ name: "skin", isovalue: -300, reason: "between air and soft tissue" }, { name: "bone", isovalue: 320, reason: "above soft tissue" }] });
  fact("placement", { deviceFromIndex: [1, 0, 0, -32, 0, 1, 0, -28, 0, 0, 1.4, -24], settingsRevision: 1, patientAxes: axes, patientAxesAnswered: answered });
  receive("copy", { bricks_left: 0, problem: "", loading: false });
  fact("settings", { settingsRevision: 1, settings: { isovalue: 320, stiffnessNPerMm: 0.6, friction: true, method: 2 } });
  receive("steering", { changes: [{ user: "lecturer-1", key: "isovalue", value: 320, time_ms: 0 }] });
  fact("series", { frames: 20, positionFrames: 2.2, playing: true, rateHz: 10 });
  fact("recording", { running: true, ticks: 12_300, lostTicks: 0 });
  receive("guests", { count: 14 });
  state.emit("copyProgress");
}
// One pose, \`seconds\` after the first; without \`seconds\`: now.
let tick = 0;
function pose(seconds = performance.now() / 1000, changed = {}) {
  const contact = Math.sin(seconds) > -0.4;
  const depth = contact ? 0.9 + 0.5 * Math.sin(2.3 * seconds) + 0.05 * Math.sin(31 * seconds) : 0;
  state.receivePose({
    sequence: ++tick, tick, timeNs: 1e9 * seconds, sentMs: 1000 * seconds, ageMs: 3 + 2 * Math.abs(Math.sin(7 * seconds)), contact, freeSide: 1, fresh: true, replayed: false,
    mode: contact ? 2 : 1, forces: { state: 3, reason: 1, limitN: 3.3 },
    hipMm: [-2 + 8 * Math.sin(seconds), 1, 2 - depth], scpHMm: [-2 + 8 * Math.sin(seconds), 1, 2], stylusOrientation: [0, 0, 0, 1],
    forceN: [0, 0, depth * 0.6], density: 320.4, isovalue: 320, missedTicks: 3, updateNs: 8400, ...changed,
  });
}
let timer = 0;
function stream() { pose(); clearInterval(timer); timer = setInterval(pose, 16); }
function fillHistory() { const end = performance.now() / 1000; for (let n = 600; n >= 0; --n) pose(end - n / 60); }
window.harness = { state, room, copy, calls, receive, fact, connect, pose, stream, fillHistory, pause: () => clearInterval(timer) };
`;

const kPolicy = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
  + "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

export async function bundle(contents, format) {
  const { outputFiles } = await build({
    stdin: { contents, resolveDir: pageFolder, loader: "ts" }, bundle: true, write: false, format, logLevel: "warning",
    alias: { shading: resolve(pageFolder, "../../shading") }, loader: { ".glsl": "text" },
  });
  return outputFiles[0].text;
}

// Returns { url, close }. Under whole/ is the page as guests get it; its gateway refuses every key.
export async function serve() {
  const files = new Map([
    ["/", ["text/html; charset=utf-8", await readFile(resolve(pageFolder, "index.html"))]],
    ["/style.css", ["text/css", await readFile(resolve(pageFolder, "style.css"))]],
    ["/app.js", ["text/javascript", await bundle(kEntry, "esm")]],
    ["/whole/app.js", ["text/javascript", await bundle('import "./src/main";', "esm")]],
  ]);
  for (const name of ["", "style.css"]) files.set(`/whole/${name}`, files.get(`/${name}`));
  const server = createServer((request, response) => {
    const file = files.get(request.url);
    const isLogin = request.url === "/whole/login";
    response.writeHead(isLogin ? 403 : file ? 200 : 404, { "Content-Type": file?.[0] ?? "text/plain", "Content-Security-Policy": kPolicy });
    response.end(isLogin ? "wrong key" : file?.[1]);
  });
  await new Promise((resume) => server.listen(0, "127.0.0.1", resume));
  return { url: `http://127.0.0.1:${server.address().port}/`, close: () => server.close() };
}

export function launch() {
  return puppeteer.launch({
    executablePath: process.env.PALPATE_CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
      "--disable-sync", "--disable-gpu"],
  });
}

// Opens the page. Problems (errors of scripts, of the policy) go to `problems`.
export async function open(browser, url, { width = 1280, height = 800, isMobile = false } = {}) {
  const page = await browser.newPage();
  page.setDefaultTimeout(20_000);
  page.problems = [];
  page.on("pageerror", (error) => page.problems.push(String(error)));
  page.on("console", (message) => {
    if (message.type() === "error") page.problems.push(message.text());
  });
  await page.setViewport({ width, height, isMobile, hasTouch: isMobile });
  await page.goto(url);
  await page.waitForFunction(() => window.harness !== undefined);
  return page;
}

// Serious and critical findings of axe-core, one line each.
export async function findings(page) {
  await page.evaluate(axe.source);
  const { violations } = await page.evaluate(() => axe.run(document, { resultTypes: ["violations"] }));
  return violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.target} ${node.failureSummary.replace(/\s+/g, " ")}`));
}
