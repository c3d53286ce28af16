// Distances from the eye to the surface in the picture that a caster shows.
import { createRequire } from "node:module";
import { dirname, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const require = createRequire(resolve(dirname(fileURLToPath(import.meta.url)), "../../client/web/page/package.json"));
const { Matrix4, Vector3 } = await import(pathToFileURL(resolve(dirname(require.resolve("three")), "three.module.js")));

// Runs in the page.
function readDepths(caster) {
  const { gl, front, shown } = caster;
  if (!shown) return null;
  const [width, height] = front.size;
  const texels = new Float32Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, front.framebuffer);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  for (const name of [gl.PACK_ROW_LENGTH, gl.PACK_SKIP_PIXELS, gl.PACK_SKIP_ROWS]) gl.pixelStorei(name, 0);
  gl.readBuffer(gl.COLOR_ATTACHMENT3);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, texels);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  const bytes = new Uint8Array(texels.filter((_, n) => n % 4 === 0).buffer);
  let depths = "";
  for (let n = 0; n < bytes.length; n += 8192) depths += String.fromCharCode(...bytes.subarray(n, n + 8192));
  return { width, height, depths: btoa(depths), clipFromD: [...shown.clipFromD], eye: shown.eye };
}

// In mm, the top row first. Infinity: no surface. `caster`: an expression of the page.
export async function distancesOf(page, caster) {
  const seen = await page.evaluate(`(${readDepths})(${caster})`);
  if (!seen) return new Float32Array(0);
  const { width, height } = seen;
  const depths = new Float32Array(new Uint8Array(Buffer.from(seen.depths, "base64")).buffer);
  const fromClip = new Matrix4().fromArray(seen.clipFromD).invert();
  const eye = new Vector3(...seen.eye);
  return depths.map((_, n) => {
    const [x, y] = [n % width, height - 1 - Math.floor(n / width)];
    const depth = depths[y * width + x];
    if (depth >= 1) return Infinity;
    const clip = new Vector3((2 * (x + 0.5)) / width - 1, (2 * (y + 0.5)) / height - 1, 2 * depth - 1);
    return clip.applyMatrix4(fromClip).distanceTo(eye);
  });
}
