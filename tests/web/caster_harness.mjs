// The page's caster in a browser, fed by hand. A scene is cast until it is fine, and its distances come back.
import { createRequire } from "node:module";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

import { distancesOf } from "./distances.mjs";

const folder = dirname(fileURLToPath(import.meta.url));
const pageFolder = resolve(folder, "../../client/web/page");
const require = createRequire(join(pageFolder, "package.json"));
const { build } = require("esbuild");
const puppeteer = require("puppeteer-core");

const kEntry = `
import { Caster } from "./src/render/caster";
import { VolumeTexture } from "./src/render/volume_texture";

const canvas = document.createElement("canvas");
const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
const arrays = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, float32: Float32Array };
const fromBase64 = (type, text) => new arrays[type](Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const toBase64 = (array) => {
  const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
  let text = "";
  for (let n = 0; n < bytes.length; n += 4096) text += String.fromCharCode(...bytes.subarray(n, n + 4096));
  return btoa(text);
};
const frame = () => new Promise((done) => requestAnimationFrame(done));
let caster = null;
let volume = null;

window.harness = {
  problem: () => Caster.problem(gl),
  volumeProblem: (shape, budget) => VolumeTexture.problem(gl, shape, budget),
  begin(shape) {
    caster ??= new Caster(gl);
    volume?.dispose();
    volume = new VolumeTexture(gl, shape);
    return volume.bytes;
  },
  put(groups) {
    for (const { place, voxels } of groups) {
      // What three.js may have left.
      gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 8);
      gl.pixelStorei(gl.UNPACK_SKIP_ROWS, 3);
      volume.putGroup(...place, fromBase64(volume.shape.type, voxels));
    }
  },
  // Steps until a picture of the request is fine. Returns the levels that were shown on the way.
  async cast(request) {
    [canvas.width, canvas.height] = request.size;
    const levels = [];
    do {
      await frame();
      for (const name of [gl.BLEND, gl.DEPTH_TEST, gl.CULL_FACE, gl.SCISSOR_TEST]) gl.enable(name);
      if (caster.step(volume, request)) levels.push(caster.level);
    } while (!caster.settled);
    return levels;
  },
  caster: () => caster,
  // Colours of the canvas, the top row first, after a clear to \`color\` and \`depth\` and the parts that are named.
  draw(color, depth, parts) {
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.depthMask(true);
    gl.clearColor(...color);
    gl.clearDepth(depth);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const part of parts) caster[part]();
    const pixels = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const rows = Array.from({ length: canvas.height }, (_, y) => {
      const from = 4 * canvas.width * (canvas.height - 1 - y);
      return [...pixels.subarray(from, from + 4 * canvas.width)];
    });
    return toBase64(Uint8Array.from(rows.flat()));
  },
  glError: () => gl.getError(),
};
`;

const bytesOf = (text) => {
  const bytes = Buffer.from(text, "base64");
  return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
};

export class Harness {
  static async start() {
    const harness = new Harness();
    const { outputFiles } = await build({
      absWorkingDir: pageFolder,
      stdin: { contents: kEntry, resolveDir: pageFolder },
      bundle: true,
      format: "esm",
      alias: { shading: resolve(pageFolder, "../../shading") },
      loader: { ".glsl": "text" },
      write: false,
      logLevel: "warning",
    });
    harness.profile = await mkdtemp(join(tmpdir(), "caster-"));
    harness.browser = await puppeteer.launch({
      executablePath: process.env.PALPATE_CHROMIUM ?? "/usr/bin/chromium",
      userDataDir: harness.profile,
      protocolTimeout: 600_000,
      args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run"],
    });
    harness.page = await harness.browser.newPage();
    harness.complaints = [];
    harness.page.on("console", (message) => harness.complaints.push(message.text()));
    harness.page.on("pageerror", (error) => harness.complaints.push(String(error)));
    await harness.page.evaluate(outputFiles[0].text);
    return harness;
  }

  async stop() {
    await this.browser?.close();
    if (this.profile) await rm(this.profile, { recursive: true, force: true });
  }

  call(name, ...given) {
    return this.page.evaluate((method, list) => window.harness[method](...list), name, given);
  }

  put(groups) {
    const coded = groups.map(({ place, voxels }) => ({ place, voxels: Buffer.from(voxels.buffer).toString("base64") }));
    return this.call("put", coded);
  }

  cast(request) {
    return this.call("cast", { ...request, clipFromD: [...request.clipFromD] });
  }

  distances() {
    return distancesOf(this.page, "harness.caster()");
  }

  async draw(color, depth, parts) {
    return new Uint8Array(bytesOf(await this.call("draw", color, depth, parts)));
  }
}
