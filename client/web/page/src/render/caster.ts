// Casts the exact surface of a volume into textures, and draws them.
//
// A change is shown coarsely at once. When nothing has changed for a while, a finer picture is cast in
// tiles, one per frame, and is shown when it is whole. A tile is cast when the graphics card has finished
// the one before, which a fence tells.
//
// The state of the context is arbitrary after each call: three.js needs renderer.resetState().
import { newCastProgram, setRequest } from "./cast_program";
import type { CastRequest } from "./cast_program";
import { CastTarget } from "./cast_target";
import { Program } from "./program";
import type { VolumeTexture } from "./volume_texture";

const kRestMs = 150;
const kCoarsest = 8;
const kLevels = [1, 2, 4, kCoarsest];
const kFirstFreeUnit = 3; // after those of the volume
const kSlowMs = 50;
// A tile takes a frame or two however small it is. Where frames are slow, small tiles would take minutes.
const kFewestPixels = 8192;

const kDrawShader = `
precision highp float;
uniform sampler2D color_texture;
uniform sampler2D depth_texture;
in highp vec2 share;
out vec4 color;

void main() {
  color = texture(color_texture, share);
  gl_FragDepth = texture(depth_texture, share).r;
}
`;

// What a picture is of.
interface Subject {
  volume: VolumeTexture;
  version: number;
  request: CastRequest;
}

interface Job {
  subject: Subject;
  level: number;
  isCoarse: boolean; // in one tile
  size: [number, number];
  nextRow: number;
}

function isSame(a: Subject, b: Subject): boolean {
  const isSameRequest = JSON.stringify(a.request) === JSON.stringify(b.request);
  return a.volume === b.volume && a.version === b.version && isSameRequest;
}

// What the graphics card is at.
interface Tile {
  fence: WebGLSync;
  isCoarse: boolean;
  pixels: number;
  since: number; // ms
  looks: number;
}

// How many pixels are cast at once, so that frames go on. It follows what earlier ones took.
class Pace {
  pixels = kFewestPixels;

  // `atOnce`: the first look has found them done, so they took a frame at most.
  took(pixels: number, ms: number, atOnce: boolean): void {
    if (ms > kSlowMs && !atOnce) this.pixels = Math.max(pixels / 2, kFewestPixels);
    else if ((atOnce || ms < kSlowMs / 3) && 2 * pixels > this.pixels) this.pixels *= 2;
  }
}

export class Caster {
  // Returns "" if the context can cast, and otherwise why not.
  static problem(gl: WebGL2RenderingContext): string {
    const can = gl.getExtension("EXT_color_buffer_float");
    return can ? "" : "the graphics driver cannot draw into textures of floats";
  }

  private readonly programs = new Map<string, Program>(); // by the kind of volume and the number of veils
  private readonly drawing: Program;
  private readonly noColors: WebGLTexture; // for a colour map that nothing reads
  private front: CastTarget;
  private back: CastTarget;
  private readonly coarsePace = new Pace();
  private readonly tilePace = new Pace();

  private wanted: Subject | null = null;
  private changedAt = 0;
  private frontJob: Job | null = null; // whose picture is shown
  private job: Job | null = null;
  private tile: Tile | null = null;

  constructor(private readonly gl: WebGL2RenderingContext) {
    gl.getExtension("EXT_color_buffer_float");
    this.drawing = new Program(gl, kDrawShader);
    this.front = new CastTarget(gl);
    this.back = new CastTarget(gl);
    this.noColors = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.noColors);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 1, 1);
  }

  // Pixels per cast pixel along a side, as shown now. 1: fine. 0: nothing is shown yet.
  get level(): number {
    return this.frontJob?.level ?? 0;
  }

  // What is shown now. It lags behind the last request while a picture is being cast.
  get shown(): CastRequest | null {
    return this.frontJob?.subject.request ?? null;
  }

  // A picture of the last request and of the volume as it is now is shown.
  get isCurrent(): boolean {
    const subject = this.frontJob?.subject;
    return subject !== undefined && subject === this.wanted && subject.version === subject.volume.version;
  }

  // It is the fine one.
  get settled(): boolean {
    return this.level === 1 && this.isCurrent;
  }

  // Call this once a frame. Returns true if the picture has changed: draw a frame then. Throws an Error with the
  // driver's words if it refuses a shader.
  step(volume: VolumeTexture, request: CastRequest): boolean {
    const gl = this.gl;
    if (gl.isContextLost() || request.size[0] < 1 || request.size[1] < 1) return false;
    volume.flush();
    const wanted = this.want({ volume, version: volume.version, request });
    if (!this.tileIsDone()) return false;
    const changed = this.finishJob();
    if (this.job?.subject !== wanted) this.job = null;
    this.job ??= this.nextJob(wanted);
    if (this.job) this.castTile(this.job);
    return changed;
  }

  // Draws the surface into the bound framebuffer, over what is there, and its depth. Call this before
  // the objects of the scene are drawn. The viewport is the framebuffer's size.
  draw(): void {
    if (this.shown) this.drawTextures(this.front.textures[0], this.front.textures[3], false);
  }

  // Draws the veils over everything that lies behind the nearest of them. Call this after the objects of the scene.
  drawVeil(): void {
    if (this.shown?.veils.length) this.drawTextures(this.front.textures[1], this.front.textures[2], true);
  }

  private want(subject: Subject): Subject {
    const before = this.wanted;
    if (before && isSame(before, subject)) return before;
    // A copy: the caller may change its own.
    this.wanted = { ...subject, request: structuredClone(subject.request) };
    this.changedAt = performance.now();
    return this.wanted;
  }

  private tileIsDone(): boolean {
    if (!this.tile) return true;
    const gl = this.gl;
    ++this.tile.looks;
    if (gl.getSyncParameter(this.tile.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.tile.fence);
    const ms = performance.now() - this.tile.since;
    const pace = this.tile.isCoarse ? this.coarsePace : this.tilePace;
    pace.took(this.tile.pixels, ms, this.tile.looks === 1);
    this.tile = null;
    return true;
  }

  // Shows the picture of the job if it is whole.
  private finishJob(): boolean {
    const job = this.job;
    if (!job || job.nextRow < job.size[1]) return false;
    [this.front, this.back] = [this.back, this.front];
    [this.frontJob, this.job] = [job, null];
    return true;
  }

  private nextJob(subject: Subject): Job | null {
    const isCoarse = this.frontJob?.subject !== subject;
    if (!isCoarse && (this.level === 1 || performance.now() - this.changedAt < kRestMs)) return null;
    const sizeAt = (level: number) => subject.request.size.map((n) => Math.ceil(n / level)) as [number, number];
    const isQuick = (level: number) => sizeAt(level)[0] * sizeAt(level)[1] <= this.coarsePace.pixels;
    const level = isCoarse ? (kLevels.find(isQuick) ?? kCoarsest) : this.level > 2 ? 2 : 1;
    return { subject, level, isCoarse, size: sizeAt(level), nextRow: 0 };
  }

  private castTile(job: Job): void {
    const gl = this.gl;
    const { volume, request } = job.subject;
    const program = this.programFor(volume.format.sampler, request.veils.length);
    if (!program.isReady() || !this.drawing.isReady()) return;
    const [width, height] = job.size;
    const rows = job.isCoarse ? height : Math.min(Math.ceil(this.tilePace.pixels / width), height - job.nextRow);
    this.back.bind(job.size);
    for (const name of [gl.BLEND, gl.CULL_FACE, gl.DEPTH_TEST, gl.STENCIL_TEST]) gl.disable(name);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, job.nextRow, width, rows);
    gl.colorMask(true, true, true, true);
    program.use();
    volume.bind(program);
    this.bindTexture(program, "color_map", kFirstFreeUnit, this.noColors);
    setRequest(program, volume, request, job.size);
    program.draw();
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const pixels = rows * width;
    this.tile = fence && { fence, isCoarse: job.isCoarse, pixels, since: performance.now(), looks: 0 };
    job.nextRow += rows;
  }

  private programFor(sampler: string, veils: number): Program {
    const key = `${sampler} ${veils}`;
    const program = this.programs.get(key) ?? newCastProgram(this.gl, sampler, veils);
    this.programs.set(key, program);
    return program;
  }

  private bindTexture(program: Program, name: string, unit: number, texture: WebGLTexture): void {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
    program.setInt(name, unit);
  }

  // Colours are premultiplied by alpha. `behindScene`: hidden by what is nearer, and leaves the depth.
  private drawTextures(color: WebGLTexture, depth: WebGLTexture, behindScene: boolean): void {
    const gl = this.gl;
    for (const name of [gl.CULL_FACE, gl.SCISSOR_TEST, gl.STENCIL_TEST]) gl.disable(name);
    for (const name of [gl.BLEND, gl.DEPTH_TEST]) gl.enable(name);
    gl.blendEquation(gl.FUNC_ADD);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(behindScene ? gl.LESS : gl.ALWAYS);
    gl.depthMask(!behindScene);
    gl.colorMask(true, true, true, true);
    this.drawing.use();
    this.bindTexture(this.drawing, "color_texture", 0, color);
    this.bindTexture(this.drawing, "depth_texture", 1, depth);
    this.drawing.draw();
  }
}
