// A slice as a picture: grey values between the voxels by linear interpolation, and lines where they equal a
// level. The time depends on the picture's size alone, not on how many lines there are.
import { clamp } from "../view/geometry";
import type { VolumeCopy } from "../volume/copy";
import type { Plane } from "../volume/grouped_volume";
import type { ValueWindow, Vec3 } from "../wire/messages";
import type { Section } from "./sections";

// Where the picture's voxels are, in its pixels, to the right and down.
export interface Frame {
  begin: number[]; // of voxel 0, at its edge
  scale: number[]; // pixels per voxel
}

export interface Level {
  value: number;
  color: [number, number, number];
}

const kLineHalfPx = 0.7;

// Of the voxels around a point.
export function valueBetween(copy: Pick<VolumeCopy, "value">, [i, j, k]: Vec3): number {
  let sum = 0;
  for (let corner = 0; corner < 8; ++corner) {
    const [a, b, c] = [i, j, k].map((at, axis) => Math.floor(at) + ((corner >> axis) & 1));
    const weight = (1 - Math.abs(i - a)) * (1 - Math.abs(j - b)) * (1 - Math.abs(k - c));
    if (weight > 0) sum += weight * copy.value(a, b, c);
  }
  return sum;
}

// For each pixel along an axis: the offsets of the voxels on both sides, and the share of the second.
interface Samples {
  first: Int32Array;
  second: Int32Array;
  share: Float32Array; // below 0: outside of the volume
}

function samplesAlong(pixels: number, begin: number, scale: number, voxels: number, sign: number, step: number): Samples {
  const samples = { first: new Int32Array(pixels), second: new Int32Array(pixels), share: new Float32Array(pixels) };
  for (let n = 0; n < pixels; ++n) {
    const along = (n + 0.5 - begin) / scale - 0.5;
    const isInside = along >= -0.5 && along <= voxels - 0.5;
    const voxel = clamp(sign > 0 ? along : voxels - 1 - along, 0, voxels - 1);
    const first = Math.min(Math.floor(voxel), Math.max(0, voxels - 2));
    samples.first[n] = first * step;
    samples.second[n] = Math.min(first + 1, voxels - 1) * step;
    samples.share[n] = isInside ? voxel - first : -1;
  }
  return samples;
}

// NaN outside of the volume.
function valuesAt(pixels: ImageData, plane: Plane, { right, down }: Section, frame: Frame): Float32Array {
  const isTurned = right.axis > down.axis; // the plane's rows go down in the picture, or to the right
  const [width, height] = isTurned ? [plane.height, plane.width] : [plane.width, plane.height];
  const [stepX, stepY] = isTurned ? [plane.width, 1] : [1, plane.width];
  const x = samplesAlong(pixels.width, frame.begin[0], frame.scale[0], width, right.sign, stepX);
  const y = samplesAlong(pixels.height, frame.begin[1], frame.scale[1], height, down.sign, stepY);
  const values = new Float32Array(pixels.width * pixels.height).fill(NaN);
  const from = plane.values;
  for (let row = 0, at = 0; row < pixels.height; ++row) {
    const [top, bottom, down] = [y.first[row], y.second[row], y.share[row]];
    for (let column = 0; column < pixels.width; ++column, ++at) {
      const [left, right, across] = [x.first[column], x.second[column], x.share[column]];
      if (down < 0 || across < 0) continue;
      const above = from[top + left] + across * (from[top + right] - from[top + left]);
      const below = from[bottom + left] + across * (from[bottom + right] - from[bottom + left]);
      values[at] = above + down * (below - above);
    }
  }
  return values;
}

// Pixels outside of the volume stay as they are.
export function paintSlice(
  pixels: ImageData, plane: Plane, section: Section, frame: Frame, window: ValueWindow, levels: Level[],
): void {
  const values = valuesAt(pixels, plane, section, frame);
  const black = window.level - window.width / 2;
  const { width, data } = pixels;
  for (let at = 0, pixel = 0; at < values.length; ++at, pixel += 4) {
    const value = values[at];
    if (Number.isNaN(value)) continue;
    data[pixel] = data[pixel + 1] = data[pixel + 2] = (255 * (value - black)) / window.width;
    data[pixel + 3] = 255;
    // The line's distance in pixels, from how fast the values change. No line where no pixel beside this one is
    // on the other side of the level: next to steep values the distance alone would promise one.
    const beside = values[(at + 1) % width === 0 ? at - 1 : at + 1];
    const slope = Math.hypot((beside - value) || 0, (values[at + width] - value) || 0);
    for (const level of levels) {
      const share = Math.min(1, kLineHalfPx + 0.5 - Math.abs(value - level.value) / slope);
      if (!(share > 0)) continue;
      const isAbove = value > level.value;
      const crosses = (other: number) => other > level.value !== isAbove && !Number.isNaN(other);
      const column = at % width;
      const around = [column > 0 ? at - 1 : -1, column < width - 1 ? at + 1 : -1, at - width, at + width];
      if (!around.some((other) => crosses(values[other] ?? NaN))) continue;
      for (let n = 0; n < 3; ++n) data[pixel + n] += share * (level.color[n] - data[pixel + n]);
    }
  }
}
