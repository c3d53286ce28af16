// A first look at the surface: cast by the processor from the overview, with few pixels. It is there before
// the graphics driver has compiled the program that casts the exact surface.
import { Matrix4, Vector3 } from "three";

import type { CastRequest } from "../render/cast_program";
import type { VolumeShape, Voxels } from "../volume/manifest";
import type { Vec3 } from "../wire/messages";
import { apply, dot, inverse, norm, normalized, subtract, turn } from "./geometry";

const kMostPixels = 12_000;
const kStep = 0.8; // voxels
const kAmbient = 0.25;

// Casts voxels of this shape; voxel (i, j, k) is at (i nj + j) nk + k. Pixels without a surface stay transparent.
export function glance(shape: VolumeShape, voxels: Voxels, request: CastRequest): ImageData {
  const shrink = Math.max(1, Math.sqrt((request.size[0] * request.size[1]) / kMostPixels));
  const [width, height] = request.size.map((edge) => Math.max(1, Math.round(edge / shrink)));
  const picture = new ImageData(width, height);
  const indexFromD = inverse(request.deviceFromIndex);
  const fromClip = new Matrix4().fromArray(request.clipFromD).invert();
  const light = lightFrom(apply(indexFromD, request.eye), shape, voxels, request);
  for (let n = 0; n < width * height; ++n) {
    const [x, y] = [n % width, Math.floor(n / width)];
    const far = new Vector3((2 * (x + 0.5)) / width - 1, 1 - (2 * (y + 0.5)) / height, 1).applyMatrix4(fromClip);
    const share = light(turn(indexFromD, subtract(far.toArray(), request.eye)));
    if (share > 0) picture.data.set([...request.color.map((part) => 255 * part * share), 255], 4 * n);
  }
  return picture;
}

// Returns a function that tells how bright a ray from the eye is (index coordinates), 0 to 1, where it first enters
// material; 0: it enters none.
function lightFrom(eye: Vec3, { size, background }: VolumeShape, voxels: Voxels, request: CastRequest): (towards: Vec3) => number {
  const value = (i: number, j: number, k: number) => {
    const isInside = i >= 0 && j >= 0 && k >= 0 && i < size[0] && j < size[1] && k < size[2];
    return isInside ? voxels[(i * size[1] + j) * size[2] + k] : background;
  };
  return (towards) => {
    const direction = normalized(towards);
    let near = 0;
    let far = Infinity;
    for (let axis = 0; axis < 3; ++axis) {
      const ends = [-1, size[axis]].map((end) => (end - eye[axis]) / direction[axis]);
      near = Math.max(near, Math.min(...ends));
      far = Math.min(far, Math.max(...ends));
    }
    for (let t = near; t < far; t += kStep) {
      const [i, j, k] = direction.map((part, axis) => Math.round(eye[axis] + t * part));
      if (value(i, j, k) > request.isovalue !== request.materialAbove) continue;
      const gradient: Vec3 = [
        value(i + 1, j, k) - value(i - 1, j, k),
        value(i, j + 1, k) - value(i, j - 1, k),
        value(i, j, k + 1) - value(i, j, k - 1),
      ];
      const facing = Math.abs(dot(gradient, direction)) / (norm(gradient) || 1);
      return kAmbient + (1 - kAmbient) * facing;
    }
    return 0;
  };
}
