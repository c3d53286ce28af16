// Three slices of the page's copy, drawn on the CPU: they work without WebGL2. They are where the user puts
// them, or go through the proxy if the user asks for it. Pointer and wheel do what they do in the desktop viewer.
import type { State } from "../state";
import { apply, column, inverse, norm } from "../view/geometry";
import { patientFrame, placeText } from "../view/patient_axes";
import type { Axis, SignedAxis } from "../view/patient_axes";
import type { VolumeCopy } from "../volume/copy";
import type { Vec3 } from "../wire/messages";
import { beginDrawing, find, font, make, paced, setAttribute, setText } from "./dom";
import { isovalueOf } from "./histogram";
import { sectionsOf } from "./sections";
import type { Section } from "./sections";
import { firstWindow, paintSlice, valueBetween } from "./slice_picture";
import type { Frame, Level, Window } from "./slice_picture";
import { valueText } from "./words";

// What the three slices share.
interface Shared {
  position: Vec3; // where they cross, in voxels of the whole volume
  followsProxy: boolean;
  window: Window | null; // null: not known yet
}

// The desktop viewer's.
const kIsovalueColor: Level["color"] = [255, 158, 38];
const kVeilColor: Level["color"] = [115, 191, 255];
const kCrossColor = "#7fe0d0"; // slices are dark in both themes

const kZoomPerStep = 1.2;
const kMostZoom = 100;
const kLongestBarShare = 0.3;

class SliceView {
  readonly element: HTMLElement;
  private readonly canvas = make("canvas", { role: "img", "aria-label": "slice" });
  private readonly slider = make("input", { type: "range", min: 0, step: 1 });
  private readonly name = make("span");
  private readonly place = make("span", { class: "note number" });
  private readonly readout = make("output", { class: "readout" });
  // Kept while nothing of it changed.
  private readonly picture = document.createElement("canvas");
  private pictureKey = "";
  private zoom = 1;
  // What is in the middle, as shares of the slice to the right and down.
  private middle: [number, number] = [0.5, 0.5];
  private pointer: [number, number] | null = null; // CSS pixels of the canvas

  constructor(
    public section: Section,
    private readonly state: State,
    private readonly copy: VolumeCopy,
    private readonly shared: Shared,
    private readonly onMove: () => void,
  ) {
    const picture = make("div", { class: "slice" }, this.canvas, this.readout);
    this.element = make("figure", {}, picture, make("figcaption", {}, this.name, this.place), this.slider);
    this.slider.addEventListener("input", () => this.step(this.slider.valueAsNumber - this.index()));
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.onPointer(event);
    });
    this.canvas.addEventListener("pointermove", (event) => this.onPointer(event));
    this.canvas.addEventListener("pointerleave", () => {
      this.pointer = null;
      onMove();
    });
    this.canvas.addEventListener("wheel", (event) => this.onWheel(event), { passive: false });
    this.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    this.canvas.addEventListener("dblclick", () => this.zoomBy(0, 0, 0));
  }

  // The slice that is shown, in voxels of the copy.
  private index(): number {
    const { axis } = this.section.across;
    return Math.min(this.size(axis) - 1, Math.max(0, Math.round(this.toBlock(axis))));
  }

  private move(blocks: Partial<Record<Axis, number>>): void {
    for (const [axis, block] of Object.entries(blocks)) this.shared.position[Number(axis)] = this.toWhole(block);
    this.shared.followsProxy = false;
    this.onMove();
  }

  private toWhole(block: number): number {
    return block * this.copy.factor + (this.copy.factor - 1) / 2;
  }

  private toBlock(axis: Axis): number {
    return (this.shared.position[axis] - (this.copy.factor - 1) / 2) / this.copy.factor;
  }

  private step(blocks: number): void {
    const { axis } = this.section.across;
    this.move({ [axis]: Math.min(this.size(axis) - 1, Math.max(0, this.index() + blocks)) });
  }

  // Left: the cross-hair. Right: window and level. With shift, or the middle button: moves the picture.
  private onPointer(event: PointerEvent): void {
    if (!this.copy.shape) return;
    this.pointer = [event.offsetX, event.offsetY];
    const moves = event.shiftKey || (event.buttons & 4) !== 0;
    if (event.buttons !== 0 && moves) {
      const frame = this.frame();
      this.middle[0] -= event.movementX / (frame.scaleX * this.size(this.section.right.axis));
      this.middle[1] -= event.movementY / (frame.scaleY * this.size(this.section.down.axis));
      this.zoomBy(1, 0, 0);
    } else if (event.buttons & 2) {
      this.dragWindow(event.movementX, event.movementY);
    } else if (event.buttons & 1) {
      const { right, down } = this.section;
      const [x, y] = this.voxelsAt(this.pointer);
      this.move({ [right.axis]: this.toVoxel(right, x), [down.axis]: this.toVoxel(down, y) });
    }
    this.onMove();
  }

  private onWheel(event: WheelEvent): void {
    event.preventDefault();
    if (event.deltaY === 0) return;
    const up = event.deltaY < 0;
    if (!event.ctrlKey) {
      this.step(up ? this.section.across.sign : -this.section.across.sign);
    } else {
      const { clientWidth, clientHeight } = this.canvas;
      this.zoomBy(up ? kZoomPerStep : 1 / kZoomPerStep, event.offsetX - clientWidth / 2, event.offsetY - clientHeight / 2);
    }
  }

  // The point this far from the middle of the canvas stays. 0: all of the slice again.
  private zoomBy(factor: number, fromMiddleX: number, fromMiddleY: number): void {
    const before = this.frame();
    this.zoom = Math.min(kMostZoom, Math.max(1, this.zoom * factor));
    const after = this.frame();
    const { right, down } = this.section;
    const moved = [
      (fromMiddleX * (1 / before.scaleX - 1 / after.scaleX)) / this.size(right.axis),
      (fromMiddleY * (1 / before.scaleY - 1 / after.scaleY)) / this.size(down.axis),
    ];
    this.middle = this.zoom === 1 ? [0.5, 0.5]
      : [0, 1].map((n) => Math.min(1, Math.max(0, this.middle[n] + moved[n]))) as [number, number];
    this.onMove();
  }

  // As the desktop viewer does: across the width, up the level.
  private dragWindow(right: number, down: number): void {
    const { shape } = this.copy;
    if (!shape || !this.shared.window) return;
    const whole = shape.valueMax - shape.valueMin || 1;
    const widthsPerPx = 4 / Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
    const { level, width } = this.shared.window;
    this.shared.window = {
      level: Math.min(shape.valueMax + whole / 2, Math.max(shape.valueMin - whole / 2, level - down * widthsPerPx * width)),
      width: Math.min(4 * whole, Math.max(1e-3 * whole, width * Math.exp(right * widthsPerPx))),
    };
  }

  private size(axis: Axis): number {
    return this.copy.shape?.size[axis] ?? 0;
  }

  // Between voxels of an axis and pixels of the picture; its own inverse.
  private toVoxel({ axis, sign }: SignedAxis, along: number): number {
    const last = this.size(axis) - 1;
    return Math.min(last, Math.max(0, sign > 0 ? along : last - along));
  }

  // Along the picture's rows and columns, in voxels of the copy.
  private voxelsAt([x, y]: [number, number]): [number, number] {
    const frame = this.frame();
    return [(x - frame.left) / frame.scaleX - 0.5, (y - frame.top) / frame.scaleY - 0.5];
  }

  // In CSS pixels of the canvas.
  private frame(): Frame {
    const { right, down } = this.section;
    const map = this.state.placement?.device_from_index;
    const edges = [0, 1, 2].map((axis) => (map ? norm(column(map, axis)) : 1));
    const [width, height] = [this.size(right.axis) * edges[right.axis], this.size(down.axis) * edges[down.axis]];
    const { clientWidth, clientHeight } = this.canvas;
    const scale = this.zoom * Math.min(clientWidth / width, clientHeight / height);
    return {
      left: clientWidth / 2 - this.middle[0] * scale * width,
      top: clientHeight / 2 - this.middle[1] * scale * height,
      scaleX: scale * edges[right.axis],
      scaleY: scale * edges[down.axis],
    };
  }

  private takePicture(index: number, version: number): void {
    const { shape } = this.copy;
    const scale = window.devicePixelRatio;
    const { left, top, scaleX, scaleY } = this.frame();
    const frame = { left: left * scale, top: top * scale, scaleX: scaleX * scale, scaleY: scaleY * scale };
    const { width, height } = this.canvas;
    const levels = [
      { value: isovalueOf(this.state), color: kIsovalueColor },
      { value: this.state.view.veil, color: kVeilColor },
    ].filter((level): level is Level => level.value !== null);
    const shown = this.shared.window;
    const key = JSON.stringify([version, index, this.section, shape, frame, width, height, levels, shown]);
    if (!shape || !shown || this.pictureKey === key) return;
    this.pictureKey = key;
    const plane = this.copy.plane(this.section.across.axis, index);
    const pixels = new ImageData(width, height);
    const ends: [number, number] = [shown.level - shown.width / 2, shown.level + shown.width / 2];
    if (plane.width > 0) paintSlice(pixels, plane, this.section, frame, ends, levels);
    [this.picture.width, this.picture.height] = [width, height];
    this.picture.getContext("2d")!.putImageData(pixels, 0, 0);
  }

  draw(version: number): void {
    const context = beginDrawing(this.canvas);
    const { right, down } = this.section;
    const index = this.index();
    this.describe(index);
    this.describePointer(index);
    if (!context) return;
    this.takePicture(index, version);
    context.drawImage(this.picture, 0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    const frame = this.frame();
    const along = (axis: SignedAxis) => this.toVoxel(axis, this.toBlock(axis.axis)) + 0.5;
    this.drawMarks(context, frame.left + along(right) * frame.scaleX, frame.top + along(down) * frame.scaleY);
    this.drawScaleBar(context, frame);
  }

  // Value and place under the pointer. The overview has means only.
  private describePointer(index: number): void {
    const { across, right, down } = this.section;
    const [x, y] = this.pointer ? this.voxelsAt(this.pointer) : [NaN, NaN];
    const isInside = x >= -0.5 && y >= -0.5 && x <= this.size(right.axis) - 0.5 && y <= this.size(down.axis) - 0.5;
    const frame = patientFrame(this.state.volume, this.state.placement);
    this.readout.hidden = !isInside || !frame;
    if (!isInside || !frame) return;
    const block: Vec3 = [0, 0, 0];
    [block[across.axis], block[right.axis], block[down.axis]] = [index, this.toVoxel(right, x), this.toVoxel(down, y)];
    const value = valueText(valueBetween(this.copy, block), this.state.volume?.unit);
    const place = apply(frame.fromIndex, block.map((n) => this.toWhole(n)) as Vec3);
    setText(this.readout, `${this.copy.factor > 1 ? "≈ " : ""}${value}\n${placeText(place, frame.isKnown)}`);
  }

  // The longest of 1, 2, 5, 10 ... mm that fits.
  private drawScaleBar(context: CanvasRenderingContext2D, frame: Frame): void {
    const map = this.state.volume?.world_from_index;
    if (!map) return;
    const pxPerMm = frame.scaleX / (norm(column(map, this.section.right.axis)) * this.copy.factor);
    const mostMm = (kLongestBarShare * this.canvas.clientWidth) / pxPerMm;
    const decade = 10 ** Math.floor(Math.log10(mostMm));
    const lengthMm = decade * (mostMm >= 5 * decade ? 5 : mostMm >= 2 * decade ? 2 : 1);
    const [end, y] = [this.canvas.clientWidth - 8, this.canvas.clientHeight - 8];
    context.fillStyle = "#fff";
    context.fillRect(end - lengthMm * pxPerMm, y, lengthMm * pxPerMm, 2);
    context.textAlign = "right";
    const text = `${Number(lengthMm.toPrecision(1))} mm`;
    context.strokeText(text, end, y - 9);
    context.fillText(text, end, y - 9);
    this.canvas.dataset.scaleBar = `${lengthMm} ${lengthMm * pxPerMm}`;
  }

  // The cross-hair, open at the point, and the directions.
  private drawMarks(context: CanvasRenderingContext2D, x: number, y: number): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    context.strokeStyle = kCrossColor;
    context.lineWidth = 1;
    context.beginPath();
    for (const [x0, y0, x1, y1] of [[0, y, x - 6, y], [x + 6, y, width, y], [x, 0, x, y - 6], [x, y + 6, x, height]]) {
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
    }
    context.stroke();
    const { labels } = this.section;
    context.font = font(this.canvas);
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = "#000";
    context.fillStyle = "#fff";
    const write = (label: string, tx: number, ty: number) => {
      context.strokeText(label, tx, ty);
      context.fillText(label, tx, ty);
    };
    const edge = 9;
    const beside = (label: string) => edge + (context.measureText(label).width - context.measureText("L").width) / 2;
    write(labels.left, beside(labels.left), height / 2);
    write(labels.right, width - beside(labels.right), height / 2);
    write(labels.up, width / 2, edge);
    write(labels.down, width / 2, height - edge);
  }

  // Indices of the whole volume, also for the overview.
  private describe(index: number): void {
    const { across, name } = this.section;
    const voxel = this.toWhole(index);
    const all = (this.state.volume?.size?.[across.axis] ?? 1) - 1;
    setText(this.name, name);
    setText(this.place, `${"xyz"[across.axis]} ${voxel} of ${all}`);
    setAttribute(this.canvas, "aria-label", `Slice ${name} at voxel ${voxel} of ${all}`);
    setAttribute(this.slider, "aria-label", `Place of the slice ${name} along ${"xyz"[across.axis]}`);
    setAttribute(this.slider, "aria-valuetext", `voxel ${voxel} of ${all}`);
    setAttribute(this.slider, "max", String(Math.max(0, this.size(across.axis) - 1)));
    this.slider.value = String(index);
  }
}

export function showSlices(root: HTMLElement, state: State, copy: VolumeCopy): void {
  const section = find(root, "slices");
  const follow = find<HTMLInputElement>(root, "slices-follow");
  const shared: Shared = { position: [0, 0, 0], followsProxy: false, window: null };
  let version = 0;
  let begun = "";
  // Another volume begins in its middle, with a window of its own.
  const begin = () => {
    const { volume } = state;
    const { shape, factor } = copy;
    // The copy may still be that of the volume before.
    if (!shape || !volume?.size || volume.size.some((n, axis) => Math.ceil(n / factor) !== shape.size[axis])) return;
    const name = JSON.stringify([volume.name, volume.size, volume.unit, shape.valueMin, shape.valueMax]);
    if (begun === name) return;
    begun = name;
    shared.position = volume.size.map((n) => (n - 1) / 2) as Vec3;
    shared.window = firstWindow(volume.unit ?? "", shape.valueMin, shape.valueMax);
  };
  const request = paced(20, () => {
    if (section.hidden || !copy.shape) return;
    begin();
    follow.checked = shared.followsProxy;
    const map = state.placement?.device_from_index;
    if (shared.followsProxy && state.pose && map) shared.position = apply(inverse(map), state.pose.scpH);
    for (const view of views) view.draw(version);
  });
  const unknown = { isKnown: false, fromIndex: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0] };
  const views = sectionsOf(unknown).map((s) => new SliceView(s, state, copy, shared, request));
  find(root, "slices-planes").append(...views.map((view) => view.element));

  const show = () => {
    section.hidden = !state.view.slices && state.whyNoPicture === "";
    request();
  };
  const orient = () => {
    const sections = sectionsOf(patientFrame(state.volume, state.placement) ?? unknown);
    views.forEach((view, n) => (view.section = sections[n]));
    request();
  };
  const changed = () => {
    ++version;
    request();
  };
  follow.addEventListener("change", () => {
    shared.followsProxy = follow.checked;
    request();
  });
  for (const topic of ["view", "picture"] as const) state.on(topic, show);
  for (const topic of ["pose", "settings"] as const) state.on(topic, request);
  state.on("copyProgress", changed);
  for (const topic of ["volume", "placement"] as const) state.on(topic, orient);
  new ResizeObserver(request).observe(section);
  orient();
  show();
}
