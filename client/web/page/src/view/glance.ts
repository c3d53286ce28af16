// A first look at the surface: cast by the processor from the overview, with few pixels. It is there before
// the graphics driver has compiled the program that casts the exact surface.
import { inverse as inverseMatrix } from "../render/matrix";
import type { CastRequest } from "../render/caster";
import type { Vec3, VolumeShape, Voxels } from "../render/types";
import { apply, inverse, norm, subtract, turn } from "./geometry";

const kMostPixels = 12_000;
const kStep = 0.8; // voxels
const kAmbient = 0.25;

// Casts voxels of this shape; voxel (i, j, k) is at (i nj + j) nk + k. Pixels without a surface stay transparent.
export function glance(shape: VolumeShape, voxels: Voxels, request: CastRequest): ImageData {
  const shrink = Math.max(1, Math.sqrt((request.size[0] * request.size[1]) / kMostPixels));
  const [width, height] = request.size.map((edge) => Math.max(1, Math.round(edge / shrink)));
  const picture = new ImageData(width, height);
  const indexFromD = inverse(request.deviceFromIndex);
  const fromClip = inverseMatrix(request.clipFromD);
  const ray = new Ray(shape, voxels, request, apply(indexFromD, request.eye));
  for (let n = 0; n < width * height; ++n) {
    const clip = [(2 * ((n % width) + 0.5)) / width - 1, 1 - (2 * (Math.floor(n / width) + 0.5)) / height, 1, 1];
    const p = [0, 1, 2, 3].map((r) => clip.reduce((sum, value, c) => sum + fromClip[4 * c + r] * value, 0));
    const towards = subtract([p[0] / p[3], p[1] / p[3], p[2] / p[3]], request.eye);
    const light = ray.light(turn(indexFromD, towards));
    if (light === 0) continue;
    picture.data.set([...request.color.map((part) => 255 * part * light), 255], 4 * n);
  }
  return picture;
}

class Ray {
  constructor(
    private readonly shape: VolumeShape,
    private readonly voxels: Voxels,
    private readonly request: CastRequest,
    private readonly eye: Vec3, // index coordinates
  ) {}

  // Of the first point where the ray enters material, 0 to 1; 0: it enters none.
  light(towards: Vec3): number {
    const direction = towards.map((part) => part / norm(towards)) as Vec3;
    let near = 0;
    let far = Infinity;
    for (let axis = 0; axis < 3; ++axis) {
      const ends = [-1, this.shape.size[axis]].map((end) => (end - this.eye[axis]) / direction[axis]);
      near = Math.max(near, Math.min(...ends));
      far = Math.min(far, Math.max(...ends));
    }
    for (let t = near; t < far; t += kStep) {
      const [i, j, k] = direction.map((part, axis) => Math.round(this.eye[axis] + t * part)) as Vec3;
      if (this.value(i, j, k) > this.request.isovalue !== this.request.materialAbove) continue;
      const gradient: Vec3 = [
        this.value(i + 1, j, k) - this.value(i - 1, j, k),
        this.value(i, j + 1, k) - this.value(i, j - 1, k),
        this.value(i, j, k + 1) - this.value(i, j, k - 1),
      ];
      const size = norm(gradient) || 1;
      const facing = Math.abs(gradient.reduce((sum, part, axis) => sum + part * direction[axis], 0)) / size;
      return kAmbient + (1 - kAmbient) * facing;
    }
    return 0;
  }

  private value(i: number, j: number, k: number): number {
    const [ni, nj, nk] = this.shape.size;
    const isInside = i >= 0 && j >= 0 && k >= 0 && i < ni && j < nj && k < nk;
    return isInside ? this.voxels[(i * nj + j) * nk + k] : this.shape.background;
  }
}
