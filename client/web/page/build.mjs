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

// Of a package without a file for it: what its bundled files begin with, and the Apache License, which is ours, too.
async function licenceInFiles(folder, licence, metafile) {
  if (!/Apache-2\.0/.test(licence)) throw new Error(`${folder}: no licence file`);
  const inputs = Object.keys(metafile.inputs).map((input) => join(page, input)).filter((input) => input.startsWith(`${folder}/`));
  const heads = (await Promise.all(inputs.map((input) => readFile(input, "utf8")))).map((text) => /^(\/\/.*\n)*/.exec(text)[0]);
  const own = await readFile(resolve(page, "../../../LICENSE"), "utf8");
  return [...new Set(heads.filter((head) => head.includes("Copyright"))), own].join("\n");
}

async function licenceOf(folder, metafile) {
  const { name, version, license } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
  const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
  const text = file ? await readFile(join(folder, file), "utf8") : await licenceInFiles(folder, license, metafile);
  return `${name} ${version}\n\n${text.trim()}\n`;
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
const licences = await Promise.all(packagesOf(metafile).map((folder) => licenceOf(folder, metafile)));
await writeFile(join(output, "licenses.txt"), licences.join(`\n${"-".repeat(80)}\n\n`));
