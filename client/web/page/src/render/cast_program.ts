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
import { Matrix4, Vector4 } from "three";

import { apply, column, compose, inverse, matrixOf, norm, normalized, row, scale, subtract, turn } from "../view/geometry";
import type { AffineMap } from "../view/geometry";
import type { Vec3 } from "../wire/messages";
import { Program } from "./program";
import type { VolumeTexture } from "./volume_texture";

export interface CastRequest {
  size: [number, number]; // of the canvas, pixels
  eye: Vec3; // in D, mm
  clipFromD: number[]; // 4 x 4, column by column
  deviceFromIndex: number[]; // 3 x 4, row by row, as the topic `placement` gives it
  isovalue: number;
  materialAbove: boolean;
  color: Vec3; // 0 to 1, as on the screen
  veils: { isovalue: number; color: Vec3 }[];
  veilOpacity: number;
}

const kMostLayers = 16; // of the veils, as on the desktop

export function newCastProgram(gl: WebGL2RenderingContext, sampler: string, veils: number): Program {
  const definitions = `#define ATLAS ${sampler}\n#define VEILS ${veils}\n#define MOST_LAYERS ${kMostLayers}\n`;
  const parts = [definitions, volumeWeb, cell, surfaceInputs, ray, walk, colors, light, surface];
  return new Program(gl, parts.join("\n"));
}

// Of (x, y, 1) in pixels right and up of the image's centre, column by column: the difference between the
// point on the near plane and the eye, in homogeneous coordinates.
function directionFromPixel(request: CastRequest, [width, height]: number[], pFromD: AffineMap): number[] {
  const fromClip = new Matrix4().fromArray(request.clipFromD).invert();
  const columns = [[2 / width, 0, 0, 0], [0, 2 / height, 0, 0], [0, 0, -1, 1]].map((clip) => {
    const { x, y, z, w } = new Vector4().fromArray(clip).applyMatrix4(fromClip);
    return turn(pFromD, subtract([x, y, z], scale(w, request.eye)));
  });
  return columns.flatMap((d) => scale(1 / norm(columns[2]), d));
}

// `size`: of the picture that is cast, which may be coarser than the request's.
export function setRequest(program: Program, volume: VolumeTexture, request: CastRequest, size: [number, number]): void {
  // In P, voxel (i, j, k) is at (i + 1, j + 1, k + 1).
  const dFromP = compose(request.deviceFromIndex, [1, 0, 0, -1, 0, 1, 0, -1, 0, 0, 1, -1]);
  const pFromD = inverse(dFromP);
  const clipFromD = new Matrix4().fromArray(request.clipFromD);
  const rowByRow = (matrix: Matrix4) => matrix.clone().transpose().elements;
  const clipFromP = rowByRow(clipFromD.clone().multiply(matrixOf(dFromP)));
  const across = (n: number): Vec3 => normalized(row(rowByRow(clipFromD), n));
  program.set("eye", ...apply(pFromD, request.eye));
  program.set("image_center", size[0] / 2, size[1] / 2, 0);
  program.setMatrix("direction_from_pixel", directionFromPixel(request, size, pFromD));
  program.set("clip_z", ...clipFromP.slice(8, 12));
  program.set("clip_w", ...clipFromP.slice(12));
  program.setMatrix("D_from_P", [0, 1, 2].flatMap((n) => column(dFromP, n)));
  // The transpose of the inverse.
  program.setMatrix("normal_D_from_P", [0, 1, 2].flatMap((n) => row(pFromD, n)));
  program.set("right_D", ...across(0));
  program.set("up_D", ...across(1));
  program.set("crop_max", ...volume.shape.size.map((n) => n + 1));
  program.setInt("surface_shown", 1);
  program.set("isovalue", ...volume.scale.split(request.isovalue));
  program.setInt("material_above", request.materialAbove ? 1 : 0);
  program.set("plain_color", ...request.color);
  program.set("steepest", 1);
  request.veils.forEach(({ isovalue, color }, n) => {
    program.set(`veil_isovalue[${n}]`, ...volume.scale.split(isovalue));
    program.set(`veil_plain_color[${n}]`, ...color);
  });
  program.set("veil_opacity", request.veilOpacity);
}
