// Casts the exact surface of a volume into textures, and draws them. Skeleton: the interface stays
// as it is here.
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

export class Caster {
  // Returns "" if the context can cast, and otherwise why not.
  static problem(_gl: WebGL2RenderingContext): string {
    return "";
  }

  constructor(_gl: WebGL2RenderingContext) {}

  // Call this once a frame. Returns true if the picture has changed: draw a frame then.
  step(_volume: VolumeTexture, _request: CastRequest): boolean {
    return false;
  }

  // Draws the surface into the bound framebuffer, over what is there, and its depth. Call this before
  // the objects of the scene are drawn. The viewport is the framebuffer's size.
  draw(): void {}

  // Draws the veil over everything that lies behind it. Call this after the objects of the scene.
  drawVeil(): void {}

  // Pixels per cast pixel along a side, as shown now. 1: fine. 0: nothing is shown yet.
  readonly level: number = 0;
  // What is shown now. It lags behind the last request while a picture is being cast.
  readonly shown: CastRequest | null = null;

  // Distances from the eye to the surface, in mm, of the picture that is shown. The top row comes first.
  // Infinity: no surface. At level n, rows have ceil(width / n) entries.
  distances(): Float32Array {
    return new Float32Array(0);
  }

  dispose(): void {}
}
