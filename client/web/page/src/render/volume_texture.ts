// A whole volume on the graphics card: its values in one 3-D texture in their own type, with a layer of
// background on every side (frame P of client/shading/shading.h), and the ranges of its bricks.
//
// Like the atlas of the desktop viewer, the textures have z along their x axis. Floats are stored scaled.
import { bytesPerVoxel, kGroupEdge, kGroupVoxels } from "../volume/manifest";
import type { VolumeShape, Voxels } from "../volume/manifest";
import type { VoxelType } from "../wire/messages";
import { BrickRanges } from "./brick_ranges";
import type { Program } from "./program";
import { ValueScale } from "./value_scale";

// `sampler`: GLSL's type.
function formatOf(gl: WebGL2RenderingContext, type: VoxelType) {
  const integer = { format: gl.RED_INTEGER };
  return {
    uint8: { ...integer, sampler: "usampler3D", internal: gl.R8UI, type: gl.UNSIGNED_BYTE },
    int16: { ...integer, sampler: "isampler3D", internal: gl.R16I, type: gl.SHORT },
    uint16: { ...integer, sampler: "usampler3D", internal: gl.R16UI, type: gl.UNSIGNED_SHORT },
    float32: { format: gl.RED, sampler: "sampler3D", internal: gl.R32F, type: gl.FLOAT },
  }[type];
}

// Along the texture's axes.
const paddedSize = ({ size }: VolumeShape) => size.map((edge) => edge + 2).reverse();
const bytesOf = (shape: VolumeShape) => paddedSize(shape).reduce((all, edge) => all * edge, bytesPerVoxel(shape.type));

function newTexture(gl: WebGL2RenderingContext, format: number, size: number[]): WebGLTexture {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_3D, texture);
  gl.texStorage3D(gl.TEXTURE_3D, 1, format, size[0], size[1], size[2]);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, name, gl.NEAREST);
  return texture;
}

// three.js leaves others.
function resetUnpacking(gl: WebGL2RenderingContext): void {
  gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  for (const name of [
    gl.UNPACK_FLIP_Y_WEBGL,
    gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL,
    gl.UNPACK_ROW_LENGTH,
    gl.UNPACK_IMAGE_HEIGHT,
    gl.UNPACK_SKIP_PIXELS,
    gl.UNPACK_SKIP_ROWS,
    gl.UNPACK_SKIP_IMAGES,
  ]) {
    gl.pixelStorei(name, 0);
  }
}

export class VolumeTexture {
  // Returns "" if a volume of this shape fits the budget and the card, and otherwise why not.
  static problem(gl: WebGL2RenderingContext, shape: VolumeShape, budgetMiB: number): string {
    const most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number;
    if (Math.max(...paddedSize(shape)) > most) {
      return `the graphics card takes at most ${most - 2} voxels along an axis`;
    }
    const mib = bytesOf(shape) / 2 ** 20;
    if (mib <= budgetMiB) return "";
    return `the volume needs ${Math.ceil(mib)} MiB on the graphics card; the limit is ${Math.ceil(budgetMiB)} MiB`;
  }

  readonly scale: ValueScale;
  readonly bytes: number; // on the graphics card
  readonly format: ReturnType<typeof formatOf>; // of the values
  // Rises with each group.
  version = 0;

  private readonly ranges: BrickRanges;
  private readonly textures: [WebGLTexture, WebGLTexture, WebGLTexture]; // values, blocks, bricks
  private readonly scaled: Float32Array | null; // scratch of one group

  // Everything is background. Throws an Error if the card has no memory for it.
  constructor(
    private readonly gl: WebGL2RenderingContext,
    readonly shape: VolumeShape,
  ) {
    gl.getExtension("EXT_color_buffer_float"); // to fill a texture of floats
    while (gl.getError() !== gl.NO_ERROR);
    this.scale = new ValueScale(shape.valueMin, shape.valueMax);
    this.ranges = new BrickRanges(shape, this.scale);
    this.format = formatOf(gl, shape.type);
    this.scaled = shape.type === "float32" ? new Float32Array(kGroupVoxels) : null;
    const { blockCount, brickCount } = this.ranges;
    this.textures = [
      newTexture(gl, this.format.internal, paddedSize(shape)),
      newTexture(gl, gl.RG32F, [...blockCount].reverse()),
      newTexture(gl, gl.RG32F, [...brickCount].reverse()),
    ];
    if (shape.background !== 0) this.fillWithBackground();
    this.uploadRanges(0, brickCount[0] - 1);
    this.bytes = bytesOf(shape) + this.ranges.bricks.byteLength + this.ranges.blocks.byteLength;
    if (gl.getError() === gl.NO_ERROR) return;
    this.dispose();
    throw new Error("the graphics card has too little memory for the volume");
  }

  // Group (a, b, c) has voxels 32a .. 32a + 31 and so on: (i, j, k) at 1024 i + 32 j + k. The array
  // is not kept. The caster draws all groups that were put before its next step().
  putGroup(a: number, b: number, c: number, voxels: Voxels): void {
    const gl = this.gl;
    const first = [a, b, c].map((n) => kGroupEdge * n);
    const [depth, height, width] = first.map((n, axis) => Math.min(kGroupEdge, this.shape.size[axis] - n));
    resetUnpacking(gl);
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, kGroupEdge);
    gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, kGroupEdge);
    gl.bindTexture(gl.TEXTURE_3D, this.textures[0]);
    const [z, y, x] = first.map((n) => n + 1);
    const { format, type } = this.format;
    gl.texSubImage3D(gl.TEXTURE_3D, 0, x, y, z, width, height, depth, format, type, this.stored(voxels));
    this.ranges.putGroup(a, b, c, voxels);
    ++this.version;
  }

  // Brings the ranges on the card up to date. The caster calls it.
  flush(): void {
    const layers = this.ranges.update();
    if (layers) this.uploadRanges(...layers);
  }

  // Binds the volume to texture units 0 to 2 and to a program in use. The caster calls it.
  bind(program: Program): void {
    const gl = this.gl;
    this.textures.forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_3D, texture);
    });
    program.setInt("atlas", 0);
    program.setInt("block_ranges", 1);
    program.setInt("brick_ranges", 2);
    program.set("texel_factor", this.shape.type === "float32" ? 1 : this.scale.factor);
    program.set("background", this.scale.scaled(this.shape.background));
    program.setInt("block_count", ...this.ranges.blockCount);
    program.setInt("cells", ...this.shape.size.map((size) => size + 1));
  }

  dispose(): void {
    for (const texture of this.textures) this.gl.deleteTexture(texture);
  }

  private stored(voxels: Voxels): Voxels {
    if (!this.scaled) return voxels;
    for (let n = 0; n < voxels.length; ++n) this.scaled[n] = this.scale.scaled(voxels[n]);
    return this.scaled;
  }

  private uploadRanges(first: number, last: number): void {
    const gl = this.gl;
    const { bricks, blocks, brickCount, blockCount } = this.ranges;
    const layer = 2 * brickCount[1] * brickCount[2];
    const upload = (texture: WebGLTexture, [nx, ny, nz]: number[], x: number, values: Float32Array): void => {
      gl.bindTexture(gl.TEXTURE_3D, texture);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, x, nz, ny, nx, gl.RG, gl.FLOAT, values);
    };
    resetUnpacking(gl);
    upload(this.textures[1], blockCount, 0, blocks);
    const layers = [last - first + 1, brickCount[1], brickCount[2]];
    upload(this.textures[2], layers, first, bricks.subarray(first * layer, (last + 1) * layer));
  }

  // On the card, layer by layer, so that nothing is uploaded.
  private fillWithBackground(): void {
    const gl = this.gl;
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.disable(gl.SCISSOR_TEST);
    gl.colorMask(true, true, true, true);
    const { type, background } = this.shape;
    const value = new Array<number>(4).fill(type === "float32" ? this.scale.scaled(background) : background);
    for (let layer = 0; layer < this.shape.size[0] + 2; ++layer) {
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, this.textures[0], 0, layer);
      if (type === "float32") gl.clearBufferfv(gl.COLOR, 0, value);
      else if (type === "int16") gl.clearBufferiv(gl.COLOR, 0, value);
      else gl.clearBufferuiv(gl.COLOR, 0, value);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(framebuffer);
  }
}
