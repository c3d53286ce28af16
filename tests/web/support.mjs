// Starts what the browser's tests need: palpated, palpate-web, Chromium. Each ends with its test.
//
// The environment says where things are: see tests/web/CMakeLists.txt.
import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import path from "node:path";

import puppeteer from "puppeteer-core";

const { env } = process;
// A test waits so long for what must come; nothing is judged by it.
export const PATIENCE_MS = 120_000;

export function dataFile(name) {
  const file = path.join(env.PALPATE_DATA_DIR, name);
  return existsSync(file) ? file : null;
}

export function sleep(ms) {
  return new Promise((done) => setTimeout(done, ms));
}

export async function until(what, holds) {
  const end = Date.now() + PATIENCE_MS;
  for (;;) {
    const result = await holds();
    if (result) return result;
    if (Date.now() > end) throw new Error(`it did not come: ${what}`);
    await sleep(20);
  }
}

export function freePort() {
  return new Promise((done, fail) => {
    const server = createServer().once("error", fail);
    server.listen(0, "127.0.0.1", () => {
      const { port } = server.address();
      server.close(() => done(port));
    });
  });
}

// Runs a program. `output` is what it has written so far.
class Program {
  constructor(command, args) {
    this.name = path.basename(command);
    this.output = "";
    this.child = spawn(command, args, { stdio: ["ignore", "pipe", "pipe"] });
    for (const stream of [this.child.stdout, this.child.stderr]) {
      stream.setEncoding("utf8").on("data", (text) => (this.output += text));
    }
    this.ended = new Promise((done) =>
      this.child.once("exit", (code, signal) => done(signal ?? code)),
    ).then((how) => (this.how = how));
  }
  async waitFor(pattern) {
    return until(`${pattern} of ${this.name}`, () => {
      const found = pattern.exec(this.output);
      if (!found && this.how !== undefined) {
        throw new Error(`${this.name} ended (${this.how}): ${this.output}`);
      }
      return found;
    });
  }
  async end(signal = "SIGTERM") {
    if (this.how === undefined) this.child.kill(signal);
    const late = setTimeout(() => this.child.kill("SIGKILL"), 20_000);
    await this.ended;
    clearTimeout(late);
    return this.how;
  }
}

export function run(command, args) {
  return new Program(command, args);
}

export async function runToEnd(command, args) {
  const program = new Program(command, args);
  const how = await program.ended;
  if (how !== 0) throw new Error(`${program.name} ended (${how}): ${program.output}`);
  return program.output;
}

// A palpated with a socket of its own, a gateway before it, and the link that the gateway prints.
export class Room {
  constructor() {
    this.folder = mkdtempSync(path.join(tmpdir(), "palpate-web."));
    this.socket = path.join(this.folder, "palpated.sock");
    this.browsers = [];
  }
  async startDaemon(volume, ...args) {
    const all = [volume, "--socket", this.socket, "--state-folder", path.join(this.folder, "state")];
    this.daemon = run(env.PALPATED, [...all, ...args]);
    await this.daemon.waitFor(/ready on/);
  }
  // `config`: TOML beside what every test needs. The same port and key each time.
  async startGateway(config = "", ...args) {
    this.port ??= await freePort();
    const key = "0123456789abcdef0123456789abcdef";
    const keyFile = path.join(this.folder, "room-key");
    if (!existsSync(keyFile)) writeFileSync(keyFile, `${key}\n`, { mode: 0o600 });
    const file = path.join(this.folder, "web.toml");
    writeFileSync(file, config, { mode: 0o600 });
    this.gateway = run(env.PALPATE_WEB, [
      "--config", file, "--socket", this.socket, "--listen", `127.0.0.1:${this.port}`,
      "--page", env.PALPATE_PAGE, "--room-key-file", keyFile, ...args,
    ]);
    this.link = (await this.gateway.waitFor(/http:\/\/\S+#room=/))[0] + key;
    return this.link;
  }
  async palpate(...args) {
    return runToEnd(env.PALPATE, [...args, "--socket", this.socket]);
  }
  // `first`: runs in the page before its scripts.
  async openBrowser({ width = 1000, height = 700, link = this.link, first = () => {} } = {}) {
    const browser = await launch();
    this.browsers.push(browser);
    const tab = await browser.newPage();
    await tab.setViewport({ width, height });
    tab.problems = [];
    tab.on("pageerror", (error) => tab.problems.push(String(error)));
    tab.on("console", (message) => {
      if (message.type() === "error") tab.problems.push(message.text());
    });
    await tab.evaluateOnNewDocument(first);
    await tab.goto(link);
    return tab;
  }
  async end() {
    for (const browser of this.browsers) await browser.close().catch(() => {});
    const ends = [];
    if (this.gateway) ends.push(await this.gateway.end());
    if (this.daemon) ends.push(await this.daemon.end());
    rmSync(this.folder, { recursive: true, force: true });
    return ends;
  }
}

export function launch(...args) {
  return puppeteer.launch({
    executablePath: env.PALPATE_CHROMIUM,
    headless: true,
    protocolTimeout: PATIENCE_MS,
    args: [
      "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic",
      "--no-first-run", "--disable-background-networking", "--disable-component-update",
      "--disable-sync", "--force-device-scale-factor=1", ...args,
    ],
  });
}

// True in the page when `expression` is; it sees window.palpate as p.
export function awaitPage(tab, expression) {
  return tab.waitForFunction(`(() => { const p = window.palpate; return p && (${expression}); })()`, {
    timeout: PATIENCE_MS,
    polling: 50,
  });
}

export async function awaitWhole(tab) {
  await awaitPage(tab, "p.copy.shape && p.copy.groupsLeft === 0 && p.copy.revision > 0");
}
