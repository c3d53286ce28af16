// The three-dimensional picture: the caster's surface and three.js's objects in one canvas. The state's view is what
// counts; the camera follows it. Draws only when something changed.
import { WebGLRenderer } from "three";

import { Caster } from "../render/caster";
import type { CastRequest } from "../render/cast_program";
import { VolumeTexture } from "../render/volume_texture";
import type { State } from "../state";
import type { VolumeShape, Voxels } from "../volume/manifest";
import type { Vec3 } from "../wire/messages";
import type { Pose } from "../wire/contract";
import { boundsIn } from "./camera";
import type { Bounds, Size } from "./camera";
import { add, compose, indexFromBlocks, norm, scale, subtract } from "./geometry";
import { glance } from "./glance";
import { cameraOf, changeCamera } from "./look";
import { faceLabels, patientFrame } from "./patient_axes";
import { followPointers } from "./pointers";
import { PalpationScene } from "./scene";
import type { Tool } from "./tool";
import { isMaterialAbove, layersOf } from "./layers";

// The desktop viewer's (client/view/drawing/view_options.h).
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

// What is drawn of a pose.
function looksOf(pose: Pose | null): string {
  return pose ? [pose.hipMm, pose.scpHMm, pose.scpVMm, pose.stylusOrientation, pose.forceN, pose.toolRadiusMm,
    pose.toolOrientation, pose.touchingBalls, pose.torqueNMm].join() : "";
}

export class Viewport {
  readonly caster: Caster;
  aimedAt = ""; // the volume that the camera was aimed at, and its sides; "": none yet

  private tool: Tool | null = null; // while another one is made, that of before is felt
  private isReplay: boolean | undefined;
  private readonly gl: WebGL2RenderingContext;
  private readonly renderer: WebGLRenderer;
  private readonly first = document.querySelector<HTMLCanvasElement>("#glance")!.getContext("2d")!;
  private readonly scene = new PalpationScene();
  private stage = ""; // the background as CSS
  private shown: VolumeTexture | null = null;
  private next: VolumeTexture | null = null; // comes
  private isDirty = true;
  private drawnPose = "";
  private frameMs = 0;

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
    followPointers(canvas, state);
    canvas.addEventListener("webglcontextlost", () => this.stop(kLost));
    new ResizeObserver(() => (this.isDirty = true)).observe(canvas);
    state.on(["volume", "placement"], () => this.takePlace());
    state.on(["view", "settings"], () => (this.isDirty = true));
    state.on("pose", () => (this.isDirty ||= looksOf(state.pose) !== this.drawnPose));
    requestAnimationFrame((now) => this.frame(now));
  }

  // All of the volume from its usual side.
  resetView(): void {
    const bounds = this.volumeBounds(0);
    if (!bounds) return;
    const [azimuthDeg, elevationDeg] = patientFrame(this.state.volume, this.state.placement)?.isKnown ? kPatientAngles : kOtherAngles;
    changeCamera(this.state, (camera) => {
      camera.set(camera.target, azimuthDeg, elevationDeg, camera.distanceMm);
      camera.fit(bounds);
    });
  }

  // The finest picture, if it comes within a few seconds.
  async png(): Promise<Blob | null> {
    const end = performance.now() + kPngMs;
    while (!this.isFine() && performance.now() < end) await new Promise((resolve) => setTimeout(resolve, kFrameMs));
    this.draw();
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }

  // Why a volume of this shape cannot be drawn; "": it can.
  problem(shape: VolumeShape, budgetMiB: number): string {
    return this.gl.isContextLost() ? kLost : VolumeTexture.problem(this.gl, shape, budgetMiB);
  }

  // A quick look at the overview, when nothing is shown yet. Resolves when it was painted.
  async glance(shape: VolumeShape, blocks: Voxels): Promise<void> {
    this.takeSize();
    const request = this.caster.shown ? null : this.request(shape);
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

  // Begins a new volume beside the one that is shown, all background. Throws if there is no memory for it.
  prepare(shape: VolumeShape): void {
    this.next?.dispose();
    this.next = null;
    this.next = new VolumeTexture(this.gl, shape);
  }

  // Of the new volume while there is one. The array is not kept.
  putGroup(a: number, b: number, c: number, voxels: Voxels): void {
    (this.next ?? this.shown)?.putGroup(a, b, c, voxels);
  }

  // Shows the new volume instead of the old one.
  present(): void {
    if (!this.next) return;
    this.shown?.dispose();
    this.shown = this.next;
    this.next = null;
  }

  get bytes(): number {
    return (this.shown?.bytes ?? 0) + (this.next?.bytes ?? 0);
  }

  // The finest picture of what is wanted now is shown; at once after a change of the view, too.
  isFine(): boolean {
    return this.caster.settled && JSON.stringify(this.caster.shown) === JSON.stringify(this.request());
  }

  // What is to be cast; null: nothing yet.
  private request(shape = this.shown?.shape): CastRequest | null {
    const map = this.state.placement?.deviceFromIndex;
    const bounds = this.volumeBounds(1);
    const isovalue = this.state.isovalue();
    if (!shape || !map || !bounds || isovalue === null) return null;
    const { veil, veilOpacity } = this.state.view;
    const size: Size = [this.canvas.width, this.canvas.height];
    const camera = cameraOf(this.state);
    return {
      size,
      eye: camera.eye(),
      clipFromD: camera.clipFromD(size, bounds),
      deviceFromIndex: compose(map, indexFromBlocks(shape.factor)),
      isovalue,
      materialAbove: isMaterialAbove(this.state),
      color: kSurfaceColor,
      veils: [...layersOf(this.state).slice(0, -1), ...(veil === null ? [] : [{ isovalue: veil, color: kVeilColor }])]
        .map(({ isovalue, color }) => ({ isovalue, color })),
      veilOpacity,
    };
  }

  // Of all voxels and so many beyond them on every side, in D.
  private volumeBounds(beyond: number): Bounds | null {
    const size = this.state.volume?.size;
    const map = this.state.placement?.deviceFromIndex;
    if (!size || !map) return null;
    return boundsIn(map, [-beyond, -beyond, -beyond], size.map((edge) => edge - 1 + beyond) as Vec3);
  }

  private takePlace(): void {
    const { volume, placement } = this.state;
    if (!volume || !placement) return;
    this.stage = ""; // the box is another one
    this.isDirty = true;
    const place = `${volume.name} ${volume.size.join()} ${placement.patientAxes}`;
    if (this.aimedAt !== place && !(this.aimedAt === "" && this.keepView)) this.resetView();
    this.aimedAt = place;
  }

  // The theme's colours: of the background and of the letters.
  private takeTheme(): void {
    const style = getComputedStyle(document.documentElement);
    const stage = style.getPropertyValue("--stage").trim() || "black";
    if (stage === this.stage) return;
    this.stage = stage;
    const { volume, placement } = this.state;
    const frame = patientFrame(volume, placement);
    if (volume && placement && frame) {
      this.scene.setBox(placement.deviceFromIndex, volume.size, faceLabels(frame), style.getPropertyValue("--text"));
    }
  }

  private frame(now: number): void {
    requestAnimationFrame((next) => this.frame(next));
    const seconds = Math.min((now - this.frameMs) / 1000, 0.1);
    this.frameMs = now;
    if (this.gl.isContextLost() || !this.takeSize()) return;
    this.followStylus(seconds);
    // The driver compiles three.js's programs at the first drawing: not before the first look is there.
    if (!this.shown) return;
    const request = this.request();
    const hasNewPicture = request !== null && this.cast(this.shown, request);
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
    const way = subtract(pose.scpHMm, view.target);
    if (norm(way) < kRestShare * view.distanceMm) return;
    this.state.setView({ target: add(view.target, scale(1 - Math.exp(-seconds / kFollowS), way)) });
  }

  private draw(): void {
    this.isDirty = false;
    this.drawnPose = looksOf(this.state.pose);
    this.takeTheme();
    const { gl, renderer, scene, canvas } = this;
    const camera = cameraOf(this.state);
    const size: Size = [canvas.width, canvas.height];
    const { settings } = this.state;
    const isOther = settings?.replayed !== this.isReplay; // the tool of before is of the other
    if (!settings?.ball?.isAwaited || isOther) this.tool = settings?.settings.tool ?? null;
    this.isReplay = settings?.replayed;
    scene.update(this.state.pose, this.tool, camera, size, size[0] / Math.max(canvas.clientWidth, 1));
    // While a picture is being cast, the objects are drawn as the picture that is shown sees them.
    const bounds = this.volumeBounds(1) ?? { min: [-50, -50, -50], max: [50, 50, 50] };
    const projection = scene.camera.projectionMatrix.fromArray(this.caster.shown?.clipFromD ?? camera.clipFromD(size, bounds));
    projection.multiply(scene.camera.matrixWorld);
    scene.camera.projectionMatrixInverse.copy(projection).invert();
    renderer.resetState();
    renderer.setRenderTarget(null);
    renderer.setClearColor(this.stage, 1);
    renderer.clear();
    gl.viewport(0, 0, ...size); // as the caster expects
    this.caster.draw();
    renderer.resetState();
    renderer.setViewport(0, 0, ...size);
    renderer.render(scene.scene, scene.camera);
    this.caster.drawVeil();
  }
}
