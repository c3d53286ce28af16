// The program that casts a ray per pixel, and its uniforms, as client/view/render/surface_caster.cpp
// sets them. The page cuts nothing and colours plainly: those uniforms stay 0.
import cell from "shading/cell.glsl";
import colors from "shading/colors.glsl";
import light from "shading/light.glsl";
import ray from "shading/ray.glsl";
import surface from "shading/surface.glsl";
import surfaceInputs from "shading/surface_inputs.glsl";
import volumeWeb from "shading/volume_web.glsl";
import walk from "shading/walk.glsl";

import { affine4, apply, invert4, invertAffine, multiply4, normalized, turn } from "./linear";
import { Program } from "./program";
import type { Vec3 } from "./types";
import type { VolumeTexture } from "./volume_texture";

export interface CastRequest {
  size: [number, number]; // of the canvas, pixels
  eye: Vec3; // in D, mm
  clipFromD: Float64Array; // 4 x 4, column by column
  deviceFromIndex: number[]; // 3 x 4, row by row, as the topic `placement` gives it
  isovalue: number;
  materialAbove: boolean;
  color: Vec3; // 0 to 1, as on the screen
  veil: { isovalue: number; opacity: number; color: Vec3 } | null;
}

const MOST_LAYERS = 16; // of the veil, as on the desktop

export function newCastProgram(gl: WebGL2RenderingContext, sampler: string, veil: boolean): Program {
  const definitions = `#define ATLAS ${sampler}\n#define VEIL ${veil}\n#define MOST_LAYERS ${MOST_LAYERS}\n`;
  const parts = [definitions, volumeWeb, cell, surfaceInputs, ray, walk, colors, light, surface];
  return new Program(gl, parts.join("\n"));
}

// In P, voxel (i, j, k) is at (i + 1, j + 1, k + 1).
function deviceFromP(deviceFromIndex: number[]): number[] {
  const map = [...deviceFromIndex];
  const origin = apply(map, [-1, -1, -1]);
  for (const axis of [0, 1, 2]) map[4 * axis + 3] = origin[axis]!;
  return map;
}

// Of (x, y, 1) in pixels right and up of the image's centre, column by column: the difference between the
// point on the near plane and the eye, in homogeneous coordinates.
function directionFromPixel(request: CastRequest, [width, height]: number[], pFromD: number[]): number[] {
  const fromClip = invert4(request.clipFromD);
  const nearOf = [
    (row: number): number => (fromClip[row]! * 2) / width!,
    (row: number): number => (fromClip[4 + row]! * 2) / height!,
    (row: number): number => fromClip[12 + row]! - fromClip[8 + row]!,
  ];
  const columns = nearOf.map((near) =>
    turn(pFromD, request.eye.map((e, axis) => near(axis) - e * near(3)) as Vec3),
  );
  const length = Math.hypot(...columns[2]!);
  return columns.flat().map((value) => value / length);
}

// `size`: of the picture that is cast, which may be coarser than the request's.
export function setRequest(
  program: Program,
  volume: VolumeTexture,
  request: CastRequest,
  size: [number, number],
): void {
  const dFromP = deviceFromP(request.deviceFromIndex);
  const pFromD = invertAffine(dFromP);
  const clipFromP = multiply4(request.clipFromD, affine4(dFromP));
  const rowOf = (matrix: Float64Array, row: number): number[] => [0, 4, 8, 12].map((c) => matrix[c + row]!);
  const axisOf = (row: number): Vec3 => normalized(rowOf(request.clipFromD, row).slice(0, 3) as Vec3);
  program.set("eye", ...apply(pFromD, request.eye));
  program.set("image_center", size[0] / 2, size[1] / 2, 0);
  program.setMatrix("direction_from_pixel", directionFromPixel(request, size, pFromD));
  program.set("clip_z", ...rowOf(clipFromP, 2));
  program.set("clip_w", ...rowOf(clipFromP, 3));
  program.setMatrix("D_from_P", [0, 1, 2].flatMap((c) => [dFromP[c]!, dFromP[4 + c]!, dFromP[8 + c]!]));
  // The transpose of the inverse.
  program.setMatrix("normal_D_from_P", [0, 4, 8].flatMap((r) => pFromD.slice(r, r + 3)));
  program.set("right_D", ...axisOf(0));
  program.set("up_D", ...axisOf(1));
  program.set("crop_max", ...volume.shape.size.map((n) => n + 1));
  program.setInt("surface_shown", 1);
  program.set("isovalue", ...volume.scale.split(request.isovalue));
  program.setInt("material_above", request.materialAbove ? 1 : 0);
  program.set("plain_color", ...request.color);
  program.set("steepest", 1);
  if (!request.veil) return;
  program.set("veil_isovalue", ...volume.scale.split(request.veil.isovalue));
  program.set("veil_plain_color", ...request.veil.color);
  program.set("veil_opacity", request.veil.opacity);
}
