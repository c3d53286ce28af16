// The three-dimensional picture: the caster's surface and three.js's objects in one canvas. The state's view is what
// counts; the camera follows it. Draws only when something changed.
import { Color, WebGLRenderer } from "three";

import { Caster } from "../render/caster";
import type { CastRequest } from "../render/caster";
import type { Vec3, VolumeShape, Voxels } from "../render/types";
import { VolumeTexture } from "../render/volume_texture";
import type { State } from "../state";
import type { VolumeTarget } from "../volume/copy";
import type { Pose } from "../wire/pose";
import { boundsIn, Camera, uprightPatient } from "./camera";
import type { Bounds, Size } from "./camera";
import { add, compose, indexFromBlocks, norm, scale, subtract } from "./geometry";
import { glance } from "./glance";
import { faceLabels, patientFrame } from "./patient_axes";
import type { PatientFrame } from "./patient_axes";
import { followPointers } from "./pointer";
import { PalpationScene } from "./scene";

// The desktop viewer's (client/view/scene/view_options.h).
const kSurfaceColor: Vec3 = [0.87, 0.8, 0.7];
const kVeilColor: Vec3 = [0.45, 0.75, 1];
const kPatientAngles = [20, 10]; // azimuth and elevation of the first look
const kOtherAngles = [30, 20];
const kMostPixelRatio = 2;
const kFollowS = 0.15;
const kLost = "the graphics card was lost: reload the page";
const kPngMs = 5000;
const kFrameMs = 100; // the longest wait for a frame
const kRestShare = 1e-3; // of the distance: a target that is this near is reached

function looksDifferent(a: Pose | null, b: Pose | null): boolean {
  const seen = (pose: Pose | null) => pose && [pose.hip, pose.scpH, pose.scpV, pose.orientation, pose.force].join();
  return seen(a) !== seen(b);
}

interface Shown {
  texture: VolumeTexture;
  factor: number;
}

export class Viewport implements VolumeTarget {
  readonly camera = new Camera();
  readonly caster: Caster;

  private readonly gl: WebGL2RenderingContext;
  private readonly renderer: WebGLRenderer;
  private readonly first = document.querySelector<HTMLCanvasElement>("#glance")!.getContext("2d")!;
  private readonly scene = new PalpationScene();
  private readonly background = new Color();
  private stage = ""; // the background as CSS
  private shown: Shown | null = null;
  private next: Shown | null = null;
  private isDirty = true;
  private drawnPose: Pose | null = null;
  private frameMs = 0;
  private aimedAt = ""; // the volume that the camera was aimed at, and its sides

  // Why there can be no picture; "": there can.
  static problem(canvas: HTMLCanvasElement): string {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
    return gl ? Caster.problem(gl) : "this browser has no WebGL2";
  }

  // `keepView`: the first volume does not change the view.
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly state: State,
    private readonly keepView: boolean,
  ) {
    this.gl = canvas.getContext("webgl2")!;
    this.caster = new Caster(this.gl);
    this.renderer = new WebGLRenderer({ canvas, context: this.gl, alpha: false });
    this.renderer.autoClear = false;
    this.renderer.debug.checkShaderErrors = false; // that waits for the driver
    followPointers(canvas, this.camera, () => [canvas.clientWidth, canvas.clientHeight], (panned) => this.moved(panned));
    canvas.addEventListener("webglcontextlost", () => this.stop(kLost));
    new ResizeObserver(() => (this.isDirty = true)).observe(canvas);
    for (const topic of ["volume", "placement"] as const) state.on(topic, () => this.takePlace());
    state.on("view", () => (this.isDirty = true));
    state.on("pose", () => (this.isDirty ||= looksDifferent(state.pose, this.drawnPose)));
    requestAnimationFrame((now) => this.frame(now));
  }

  // All of the volume from its usual side.
  resetView(): void {
    const bounds = this.volumeBounds([0, 0, 0], -1);
    if (!bounds) return;
    const [azimuthDeg, elevationDeg] = this.frameOfPatient()?.isKnown ? kPatientAngles : kOtherAngles;
    this.camera.set(this.camera.target, azimuthDeg, elevationDeg, this.camera.distanceMm);
    this.camera.fit(bounds);
    this.moved(false);
  }

  // The finest picture, if it comes within a few seconds.
  async png(): Promise<Blob | null> {
    const end = performance.now() + kPngMs;
    while (!this.isFine() && performance.now() < end) await new Promise((resolve) => setTimeout(resolve, kFrameMs));
    this.draw();
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }

  problem(shape: VolumeShape, budgetBytes: number): string {
    return this.gl.isContextLost() ? kLost : VolumeTexture.problem(this.gl, shape, budgetBytes);
  }

  async glance(shape: VolumeShape, blocks: Voxels, factor: number): Promise<void> {
    this.takeSize();
    const request = this.caster.shown ? null : this.request(factor);
    if (!request) return;
    const picture = glance(shape, blocks, request);
    const { canvas } = this.first;
    [canvas.width, canvas.height] = [picture.width, picture.height];
    this.first.putImageData(picture, 0, 0);
    canvas.hidden = false;
    this.state.emit("picture");
    // A tab in the background has no frames.
    await new Promise((resolve) => {
      requestAnimationFrame(() => setTimeout(resolve));
      setTimeout(resolve, kFrameMs);
    });
  }

  prepare(shape: VolumeShape, factor: number): void {
    this.next?.texture.dispose();
    this.next = null;
    this.next = { texture: new VolumeTexture(this.gl, shape), factor };
  }

  putGroup(a: number, b: number, c: number, voxels: Voxels): void {
    (this.next ?? this.shown)?.texture.putGroup(a, b, c, voxels);
  }

  present(): void {
    if (!this.next) return;
    this.shown?.texture.dispose();
    this.shown = this.next;
    this.next = null;
  }

  get hasPicture(): boolean {
    return !this.first.canvas.hidden || this.caster.shown !== null;
  }

  get isAimed(): boolean {
    return this.aimedAt !== "";
  }

  eye(): Vec3 {
    return this.camera.eye();
  }

  get bytes(): number {
    return (this.shown?.texture.bytes ?? 0) + (this.next?.texture.bytes ?? 0);
  }

  // The finest picture of what is wanted now is shown; at once after a change of the view, too.
  isFine(): boolean {
    const { target, azimuthDeg, elevationDeg, distanceMm } = this.state.view;
    this.camera.set(target, azimuthDeg, elevationDeg, distanceMm);
    const text = (request: CastRequest | null) => JSON.stringify(request && { ...request, clipFromD: [...request.clipFromD] });
    return this.caster.settled && text(this.caster.shown) === text(this.request());
  }

  // What is to be cast; null: nothing yet.
  request(factor = this.shown?.factor): CastRequest | null {
    const map = this.state.placement?.device_from_index;
    const bounds = this.volumeBounds([-1, -1, -1], 0);
    const isovalue = this.isovalue();
    if (!factor || !map || !bounds || isovalue === null) return null;
    const { veil, veilOpacity } = this.state.view;
    const size: Size = [this.canvas.width, this.canvas.height];
    return {
      size,
      eye: this.camera.eye(),
      clipFromD: this.camera.clipFromD(size, bounds),
      deviceFromIndex: compose(map, indexFromBlocks(factor)),
      isovalue,
      materialAbove: !(this.state.pose?.freeAbove ?? false),
      color: kSurfaceColor,
      veil: veil === null ? null : { isovalue: veil, opacity: veilOpacity, color: kVeilColor },
    };
  }

  private isovalue(): number | null {
    const set = this.state.settings?.values.isovalue;
    return typeof set === "number" ? set : (this.state.pose?.isovalue ?? null);
  }

  // From voxel `low` to `beyond` past the number of voxels, in D.
  private volumeBounds(low: Vec3, beyond: number): Bounds | null {
    const size = this.state.volume?.size;
    const map = this.state.placement?.device_from_index;
    return size && map ? boundsIn(map, low, size.map((edge) => edge + beyond) as Vec3) : null;
  }

  private frameOfPatient(): PatientFrame | null {
    return patientFrame(this.state.volume, this.state.placement);
  }

  private takePlace(): void {
    const { volume, placement } = this.state;
    if (!volume?.size || !placement) return;
    const frame = this.frameOfPatient();
    this.camera.upright = frame?.isKnown ? uprightPatient(placement.device_from_index, frame.fromIndex) : new Camera().upright;
    this.stage = ""; // the box is another one
    this.isDirty = true;
    const place = `${volume.name} ${volume.size.join()} ${placement.patient_axes}`;
    if (this.aimedAt !== place && !(this.aimedAt === "" && this.keepView)) this.resetView();
    this.aimedAt = place;
  }

  // The theme's colours: of the background and of the letters.
  private takeTheme(): void {
    const style = getComputedStyle(document.documentElement);
    const stage = style.getPropertyValue("--stage").trim() || "black";
    if (stage === this.stage) return;
    this.stage = stage;
    this.background.set(stage);
    const { volume, placement } = this.state;
    const frame = this.frameOfPatient();
    if (volume?.size && placement && frame) {
      this.scene.setBox(placement.device_from_index, volume.size, faceLabels(frame), style.getPropertyValue("--text"));
    }
  }

  // The guest moved the camera.
  private moved(panned: boolean): void {
    const { camera, state } = this;
    const { target, azimuthDeg, elevationDeg, distanceMm } = camera;
    Object.assign(state.view, { target, azimuthDeg, elevationDeg, distanceMm });
    if (panned) state.view.follow = false;
    state.emit("view");
  }

  private frame(now: number): void {
    requestAnimationFrame((next) => this.frame(next));
    const seconds = Math.min((now - this.frameMs) / 1000, 0.1);
    this.frameMs = now;
    if (this.gl.isContextLost()) return;
    if (!this.takeSize()) return;
    this.followStylus(seconds);
    const { target, azimuthDeg, elevationDeg, distanceMm } = this.state.view;
    this.camera.set(target, azimuthDeg, elevationDeg, distanceMm);
    // The driver compiles three.js's programs at the first drawing: not before the first look is there.
    if (!this.shown) return;
    const request = this.request();
    const hasNewPicture = request !== null && this.cast(this.shown.texture, request);
    if (hasNewPicture) {
      this.first.canvas.hidden = true;
      this.state.emit("picture");
    }
    if (hasNewPicture || this.isDirty) this.draw();
  }

  private cast(texture: VolumeTexture, request: CastRequest): boolean {
    if (this.state.whyNoPicture !== "") return false;
    try {
      return this.caster.step(texture, request);
    } catch (error) {
      this.stop(`the surface cannot be drawn: ${(error as Error).message}`);
      return false;
    }
  }

  private stop(why: string): void {
    this.state.whyNoPicture = why;
    this.state.emit("picture");
  }

  // False: the canvas is hidden.
  private takeSize(): boolean {
    const ratio = Math.min(devicePixelRatio, kMostPixelRatio);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((n) => Math.round(n * ratio));
    if (width === 0 || height === 0) return false;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.renderer.setSize(width, height, false);
      this.isDirty = true;
    }
    return true;
  }

  private followStylus(seconds: number): void {
    const { view, pose } = this.state;
    if (!view.follow || !pose) return;
    const way = subtract(pose.scpH, view.target);
    if (norm(way) < kRestShare * view.distanceMm) return;
    view.target = add(view.target, scale(1 - Math.exp(-seconds / kFollowS), way));
    this.state.emit("view");
  }

  private draw(): void {
    this.isDirty = false;
    this.drawnPose = this.state.pose;
    this.takeTheme();
    const { gl, renderer, scene, canvas } = this;
    const size: Size = [canvas.width, canvas.height];
    scene.update(this.state.pose, this.camera, size, renderer.domElement.width / Math.max(canvas.clientWidth, 1));
    this.takeProjection(size);
    renderer.resetState();
    renderer.setRenderTarget(null);
    renderer.setClearColor(this.background, 1);
    renderer.clear();
    gl.viewport(0, 0, ...size); // as the caster expects
    const hasSurface = this.shown !== null && this.caster.shown !== null;
    if (hasSurface) this.caster.draw();
    renderer.resetState();
    renderer.setViewport(0, 0, ...size);
    renderer.render(scene.scene, scene.camera);
    if (hasSurface) this.caster.drawVeil();
  }

  // While a picture is being cast, the objects are drawn as the picture that is shown sees them.
  private takeProjection(size: Size): void {
    const { camera } = this.scene;
    const bounds = this.volumeBounds([-1, -1, -1], 0) ?? { min: [-50, -50, -50], max: [50, 50, 50] };
    const clipFromD = this.caster.shown?.clipFromD ?? this.camera.clipFromD(size, bounds);
    camera.projectionMatrix.fromArray(clipFromD).multiply(camera.matrixWorld);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  }
}
