// Three slices of the page's copy, drawn on the CPU: they work without WebGL2. They go through the proxy, or
// where the user puts them.
import type { State } from "../state";
import { apply, column, compose, indexFromBlocks, inverse, norm } from "../view/geometry";
import { patientFrame } from "../view/patient_axes";
import type { Axis, SignedAxis } from "../view/patient_axes";
import type { VolumeCopy } from "../volume/copy";
import type { Vec3 } from "../wire/messages";
import { beginDrawing, find, font, make, paced, setAttribute, setText } from "./dom";
import { isovalueOf } from "./histogram";
import { sectionsOf } from "./sections";
import type { Section } from "./sections";
import { paintSlice } from "./slice_picture";
import type { Frame, Level } from "./slice_picture";

// Where the slices are, in voxels of the copy.
interface Cross {
  position: Vec3;
  followsProxy: boolean;
}

// The desktop viewer's.
const kIsovalueColor: Level["color"] = [255, 158, 38];
const kVeilColor: Level["color"] = [115, 191, 255];
const kCrossColor = "#7fe0d0"; // slices are dark in both themes

class SliceView {
  readonly element: HTMLElement;
  private readonly canvas = make("canvas", { role: "img", "aria-label": "slice" });
  private readonly slider = make("input", { type: "range", min: 0, step: 1 });
  private readonly name = make("span");
  private readonly place = make("span", { class: "note number" });
  // Kept while nothing of it changed.
  private readonly picture = document.createElement("canvas");
  private pictureKey = "";

  constructor(
    public section: Section,
    private readonly state: State,
    private readonly copy: VolumeCopy,
    private readonly cross: Cross,
    private readonly onMove: () => void,
  ) {
    this.element = make("figure", {}, this.canvas, make("figcaption", {}, this.name, this.place), this.slider);
    this.slider.addEventListener("input", () => this.move({ [this.section.across.axis]: this.slider.valueAsNumber }));
    this.canvas.addEventListener("pointerdown", (event) => this.onPointer(event));
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.onPointer(event);
    });
  }

  private move(position: Partial<Record<Axis, number>>): void {
    Object.assign(this.cross.position, position);
    this.cross.followsProxy = false;
    this.onMove();
  }

  private onPointer(event: PointerEvent): void {
    const { right, down } = this.section;
    const frame = this.frame();
    const area = this.canvas.getBoundingClientRect();
    const x = (event.clientX - area.left - frame.left) / frame.scaleX - 0.5;
    const y = (event.clientY - area.top - frame.top) / frame.scaleY - 0.5;
    this.move({ [right.axis]: this.toVoxel(right, x), [down.axis]: this.toVoxel(down, y) });
  }

  private size(axis: Axis): number {
    return this.copy.shape?.size[axis] ?? 0;
  }

  // Between voxels of an axis and pixels of the picture; its own inverse.
  private toVoxel({ axis, sign }: SignedAxis, along: number): number {
    const last = this.size(axis) - 1;
    return Math.min(last, Math.max(0, sign > 0 ? along : last - along));
  }

  // In CSS pixels of the canvas.
  private frame(): Frame {
    const { right, down } = this.section;
    const map = this.state.placement?.device_from_index;
    const edges = [0, 1, 2].map((axis) => (map ? norm(column(map, axis)) : 1));
    const [width, height] = [this.size(right.axis) * edges[right.axis], this.size(down.axis) * edges[down.axis]];
    const { clientWidth, clientHeight } = this.canvas;
    const scale = Math.min(clientWidth / width, clientHeight / height);
    return {
      left: (clientWidth - scale * width) / 2,
      top: (clientHeight - scale * height) / 2,
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
    const key = JSON.stringify([version, index, this.section, shape, frame, width, height, levels]);
    if (!shape || this.pictureKey === key) return;
    this.pictureKey = key;
    const plane = this.copy.plane(this.section.across.axis, index);
    const pixels = new ImageData(width, height);
    if (plane.width > 0) paintSlice(pixels, plane, this.section, frame, [shape.valueMin, shape.valueMax], levels);
    [this.picture.width, this.picture.height] = [width, height];
    this.picture.getContext("2d")!.putImageData(pixels, 0, 0);
  }

  draw(version: number): void {
    const context = beginDrawing(this.canvas);
    const { across, right, down } = this.section;
    const { position } = this.cross;
    const index = Math.min(this.size(across.axis) - 1, Math.max(0, Math.round(position[across.axis])));
    this.describe(index);
    if (!context) return;
    this.takePicture(index, version);
    context.drawImage(this.picture, 0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    const frame = this.frame();
    const x = frame.left + (this.toVoxel(right, position[right.axis]) + 0.5) * frame.scaleX;
    const y = frame.top + (this.toVoxel(down, position[down.axis]) + 0.5) * frame.scaleY;
    this.drawMarks(context, x, y);
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
    const { factor } = this.copy;
    const voxel = index * factor + (factor - 1) / 2;
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
  const cross: Cross = { position: [0, 0, 0], followsProxy: true };
  let version = 0;
  const request = paced(10, () => {
    if (section.hidden || !copy.shape) return;
    follow.checked = cross.followsProxy;
    const map = state.placement?.device_from_index;
    if (cross.followsProxy && state.pose && map) {
      cross.position = apply(inverse(compose(map, indexFromBlocks(copy.factor))), state.pose.scpH);
    }
    for (const view of views) view.draw(version);
  });
  const unknown = { isKnown: false, fromIndex: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0] };
  const views = sectionsOf(unknown).map((s) => new SliceView(s, state, copy, cross, request));
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
    cross.followsProxy = follow.checked;
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
