// Builds the page: node build.mjs [OUTPUT FOLDER, by default dist]
//
// The result is static files: index.html, style.css, app.js and licenses.txt, which holds the
// licences of the packages that app.js contains.
import { copyFile, mkdir, readFile, readdir, writeFile } from "node:fs/promises";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

import { build } from "esbuild";

const page = dirname(fileURLToPath(import.meta.url));
const output = resolve(process.argv[2] ?? join(page, "dist"));

// The folders node_modules/NAME (or node_modules/@SCOPE/NAME) that the bundle has files of.
function packagesOf(metafile) {
  const folders = new Set();
  for (const input of Object.keys(metafile.inputs)) {
    const found = /^(.*node_modules\/(?:@[^/]+\/)?[^/]+)\//.exec(input);
    if (found) folders.add(join(page, found[1]));
  }
  return [...folders].sort();
}

async function licenceOf(folder) {
  const { name, version } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
  const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
  if (!file) throw new Error(`${name}: no licence file`);
  return `${name} ${version}\n\n${(await readFile(join(folder, file), "utf8")).trim()}\n`;
}

await mkdir(output, { recursive: true });
const { metafile } = await build({
  absWorkingDir: page,
  entryPoints: ["src/main.ts"],
  outfile: join(output, "app.js"),
  bundle: true,
  minify: true,
  format: "esm",
  charset: "utf8",
  legalComments: "none", // they are in licenses.txt
  target: ["chrome100", "firefox100", "safari15.4"],
  alias: { shading: resolve(page, "../../shading") },
  loader: { ".glsl": "text" },
  metafile: true,
  logLevel: "warning",
});
for (const file of ["index.html", "style.css"]) {
  await copyFile(join(page, file), join(output, file));
}
const licences = await Promise.all(packagesOf(metafile).map(licenceOf));
await writeFile(join(output, "licenses.txt"), licences.join(`\n${"-".repeat(80)}\n\n`));
