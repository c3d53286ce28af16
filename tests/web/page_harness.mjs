// The page's modules in node, without a browser.
import { createRequire } from "node:module";
import { dirname, resolve } from "node:path";
import { fileURLToPath } from "node:url";

export const pageFolder = resolve(dirname(fileURLToPath(import.meta.url)), "../../client/web/page");
const { build } = createRequire(resolve(pageFolder, "package.json"))("esbuild");

// All that the files of `src` export, as one module.
export async function modules(...files) {
  const contents = files.map((file) => `export * from "./src/${file}";`).join("\n");
  const { outputFiles } = await build({
    stdin: { contents, resolveDir: pageFolder, loader: "ts" }, bundle: true, write: false, format: "esm", logLevel: "warning",
  });
  return import(`data:text/javascript;base64,${Buffer.from(outputFiles[0].text).toString("base64")}`);
}

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
