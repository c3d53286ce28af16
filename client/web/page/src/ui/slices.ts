// Three slices of the page's copy, drawn on the CPU: they work without WebGL2. They are where the guest puts
// them, or go through the proxy if the guest asks for it. Pointer and wheel do what they do in the desktop viewer.
import type { State } from "../state";
import { apply, clamp, column, inverse, norm } from "../view/geometry";
import { patientFrame, placeText } from "../view/patient_axes";
import type { Axis, SignedAxis } from "../view/patient_axes";
import { Pointers, wheelSteps } from "../view/pointers";
import { layersOf } from "../view/layers";
import type { VolumeCopy } from "../volume/copy";
import type { ValueWindow, Vec3 } from "../wire/messages";
import { beginDrawing, find, make, paced, setAttribute, setText } from "./dom";
import { sectionsOf } from "./sections";
import type { Section } from "./sections";
import { drawCross, drawLabels, drawScaleBar } from "./slice_marks";
import { paintSlice, valueBetween } from "./slice_picture";
import type { Frame, Level } from "./slice_picture";
import { dragged, windowsOf } from "./value_window";
import { valueText } from "./words";

// What the three slices share.
interface Shared {
  position: Vec3; // where they cross, in voxels of the whole volume
  window: ValueWindow | null; // null: not known yet
  drags: HTMLInputElement; // checked: the first button or finger drags the window
}

// The desktop viewer's.
const kIsovalueColor: Level["color"] = [255, 158, 38];
const kVeilColor: Level["color"] = [115, 191, 255];

const kZoomPerStep = 1.2;
const kMostZoom = 100;
// Until a volume is there.
const kNoFrame = { isKnown: false, fromIndex: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0] };

class SliceView {
  readonly element: HTMLElement;
  private readonly canvas = make("canvas", { role: "img", "aria-label": "slice" });
  private readonly slider = make("input", { type: "range", min: 0, step: 1 });
  private readonly name = make("span");
  private readonly place = make("span", { class: "note" });
  private readonly readout = make("span", { class: "readout" });
  private readonly pointers = new Pointers(this.canvas, (event) => this.onPointer(event));
  // Kept while nothing of it changed.
  private readonly picture = document.createElement("canvas");
  private pictureKey = "";
  private zoom = 1;
  private wheel = 0; // steps that are not taken yet
  // What is in the middle of the canvas, as shares of the slice to the right and down.
  private middle = [0.5, 0.5];
  private pointer: [number, number] | null = null; // CSS pixels of the canvas
  private before: Vec3[] = []; // where the slices were before the last two presses

  // `onMove`: the guest moved the slices. `onChange`: the pictures must be drawn again.
  constructor(
    public section: Section,
    private readonly state: State,
    private readonly copy: VolumeCopy,
    private readonly shared: Shared,
    private readonly onMove: () => void,
    private readonly onChange: () => void,
  ) {
    const caption = make("figcaption", {}, this.name, this.place, this.readout);
    this.element = make("figure", {}, this.canvas, caption, this.slider);
    this.slider.addEventListener("input", () => this.step(this.slider.valueAsNumber - this.index()));
    this.canvas.addEventListener("pointermove", (event) => this.onPointer(event));
    this.canvas.addEventListener("pointerleave", () => {
      this.pointer = null;
      onChange();
    });
    this.canvas.addEventListener("wheel", (event) => this.onWheel(event), { passive: false });
    this.canvas.addEventListener("dblclick", () => {
      this.showAll();
      shared.position = this.before[0];
      onMove();
    });
  }

  showAll(): void {
    this.zoom = 1;
    this.middle = [0.5, 0.5];
  }

  // The slice that is shown, in voxels of the copy.
  private index(): number {
    const { axis } = this.section.across;
    return clamp(Math.round(this.toBlock(axis)), 0, this.size(axis) - 1);
  }

  private move(blocks: Partial<Record<Axis, number>>): void {
    for (const [axis, block] of Object.entries(blocks)) this.shared.position[Number(axis)] = this.toWhole(block);
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
    this.move({ [axis]: clamp(this.index() + blocks, 0, this.size(axis) - 1) });
  }

  // First button: the cross-hair. Right: window and level. With Shift, the middle button or two fingers: moves the
  // picture; fingers that spread come closer.
  private onPointer(event: PointerEvent): void {
    const { volume } = this.state;
    if (!this.copy.shape || !volume) return;
    this.pointer = [event.offsetX, event.offsetY];
    const drag = event.type === "pointermove" ? this.pointers.drag(event) : null;
    if (event.type === "pointerdown") this.before = [...this.before, [...this.shared.position] as Vec3].slice(-2);
    const pans = event.shiftKey || (event.buttons & 4) !== 0 || this.pointers.hadSeveral;
    if (drag && pans) {
      this.zoomAbout(this.pointer, drag.spread, [drag.right, drag.down]);
    } else if (event.buttons & 2 || this.shared.drags.checked) {
      const picturePx = Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
      const { window } = this.shared;
      if (drag && window) this.shared.window = dragged(volume, window, drag.right, drag.down, picturePx);
    } else if (event.buttons & 1 && !pans) {
      const { right, down } = this.section;
      const [x, y] = this.voxelsAt(this.pointer);
      this.move({ [right.axis]: this.toVoxel(right, x), [down.axis]: this.toVoxel(down, y) });
    }
    this.onChange();
  }

  private onWheel(event: WheelEvent): void {
    event.preventDefault();
    if (!this.copy.shape) return;
    const up = -wheelSteps(event);
    this.wheel += event.ctrlKey ? 0 : up; // trackpads send small parts of a step
    const slices = Math.trunc(this.wheel);
    this.wheel -= slices;
    if (event.ctrlKey) this.zoomAbout([event.offsetX, event.offsetY], kZoomPerStep ** up, [0, 0]);
    else if (slices !== 0) this.step(slices * this.section.across.sign);
    this.onChange();
  }

  // What is at this place stays there, but for the pixels moved to the right and down.
  private zoomAbout(place: number[], factor: number, moved: number[]): void {
    const edges = [this.canvas.clientWidth, this.canvas.clientHeight];
    const before = this.frame().scale;
    this.zoom = clamp(this.zoom * factor, 1, kMostZoom);
    const after = this.frame().scale;
    this.middle = this.axes().map(({ axis }, n) => {
      const voxels = (place[n] - edges[n] / 2) * (1 / before[n] - 1 / after[n]) - moved[n] / after[n];
      return this.zoom === 1 ? 0.5 : clamp(this.middle[n] + voxels / this.size(axis), 0, 1);
    });
  }

  private axes(): SignedAxis[] {
    return [this.section.right, this.section.down];
  }

  private size(axis: Axis): number {
    return this.copy.shape?.size[axis] ?? 0;
  }

  // Between voxels of an axis and pixels of the picture; its own inverse.
  private toVoxel({ axis, sign }: SignedAxis, along: number): number {
    const last = this.size(axis) - 1;
    return clamp(sign > 0 ? along : last - along, 0, last);
  }

  // Along the picture's rows and columns, in voxels of the copy.
  private voxelsAt(place: number[]): number[] {
    const { begin, scale } = this.frame();
    return place.map((at, n) => (at - begin[n]) / scale[n] - 0.5);
  }

  // In CSS pixels of the canvas.
  private frame(): Frame {
    const map = this.state.placement?.deviceFromIndex;
    const voxelMm = this.axes().map(({ axis }) => (map ? norm(column(map, axis)) : 1));
    const sizeMm = this.axes().map(({ axis }, n) => this.size(axis) * voxelMm[n]);
    const edges = [this.canvas.clientWidth, this.canvas.clientHeight];
    const pxPerMm = this.zoom * Math.min(edges[0] / sizeMm[0], edges[1] / sizeMm[1]);
    return {
      begin: edges.map((edge, n) => edge / 2 - this.middle[n] * pxPerMm * sizeMm[n]),
      scale: voxelMm.map((mm) => pxPerMm * mm),
    };
  }

  private takePicture(index: number, version: number): void {
    const { shape } = this.copy;
    const { begin, scale } = this.frame();
    const inPixels = (cssPixels: number) => cssPixels * window.devicePixelRatio;
    const frame = { begin: begin.map(inPixels), scale: scale.map(inPixels) };
    const { width, height } = this.canvas;
    const levels = [
      ...(layersOf(this.state).length > 0 ? [] : [{ value: this.state.isovalue(), color: kIsovalueColor }]),
      ...layersOf(this.state)
        .map(({ isovalue, color }) => ({ value: isovalue, color: color.map((part) => 255 * part) as Level["color"] })),
      { value: this.state.view.veil, color: kVeilColor },
    ].filter((level): level is Level => level.value !== null);
    const shown = this.shared.window;
    const key = JSON.stringify([version, index, this.section, shape, frame, width, height, levels, shown]);
    if (!shape || !shown || this.pictureKey === key) return;
    this.pictureKey = key;
    const plane = this.copy.plane(this.section.across.axis, index);
    const pixels = new ImageData(width, height);
    if (plane.width > 0) paintSlice(pixels, plane, this.section, frame, shown, levels);
    [this.picture.width, this.picture.height] = [width, height];
    this.picture.getContext("2d")!.putImageData(pixels, 0, 0);
  }

  draw(version: number): void {
    const context = beginDrawing(this.canvas);
    const index = this.index();
    this.describe(index);
    this.describePointer(index);
    if (!context) return;
    this.takePicture(index, version);
    context.drawImage(this.picture, 0, 0, this.canvas.clientWidth, this.canvas.clientHeight);
    const { begin, scale } = this.frame();
    const [x, y] = this.axes().map((axis, n) => begin[n] + scale[n] * (this.toVoxel(axis, this.toBlock(axis.axis)) + 0.5));
    drawCross(context, x, y);
    drawLabels(context, this.section.labels);
    const map = this.state.volume?.worldFromIndex;
    if (map) drawScaleBar(context, scale[0] / (norm(column(map, this.section.right.axis)) * this.copy.factor));
  }

  // Value and place under the pointer. The overview has means only.
  private describePointer(index: number): void {
    const { across, right, down } = this.section;
    const at = this.pointer ? this.voxelsAt(this.pointer) : [NaN, NaN];
    const isInside = this.axes().every(({ axis }, n) => at[n] >= -0.5 && at[n] <= this.size(axis) - 0.5);
    const frame = patientFrame(this.state.volume, this.state.placement);
    this.readout.hidden = !isInside || !frame;
    this.place.hidden = !this.readout.hidden;
    if (!isInside || !frame) return;
    const block: Vec3 = [0, 0, 0];
    [block[across.axis], block[right.axis], block[down.axis]] = [index, this.toVoxel(right, at[0]), this.toVoxel(down, at[1])];
    const value = valueText(valueBetween(this.copy, block), this.state.volume?.unit);
    const place = apply(frame.fromIndex, block.map((n) => this.toWhole(n)) as Vec3);
    setText(this.readout, `${this.copy.factor > 1 ? "≈ " : ""}${value}\n${placeText(place, frame.isKnown)}`);
  }

  // Indices of the whole volume, also for the overview.
  private describe(index: number): void {
    const { across: { axis }, name } = this.section;
    const place = `${this.toWhole(index)} of ${(this.state.volume?.size[axis] ?? 1) - 1}`;
    setText(this.name, name);
    setText(this.place, `${"xyz"[axis]} ${place}`);
    setAttribute(this.canvas, "aria-label", `Slice ${name} at voxel ${place}`);
    setAttribute(this.slider, "aria-label", `Place of the slice ${name} along ${"xyz"[axis]}`);
    setAttribute(this.slider, "aria-valuetext", `voxel ${place}`);
    setAttribute(this.slider, "max", String(Math.max(0, this.size(axis) - 1)));
    this.slider.value = String(index);
  }
}

// The choice of the values that are black and white; returns a function that shows what is chosen.
function showWindows(state: State, shared: Shared, onChange: () => void): () => void {
  const select = find<HTMLSelectElement>("slices-window");
  const windows = () => (state.volume ? windowsOf(state.volume) : []);
  select.addEventListener("change", () => {
    shared.window = windows()[select.selectedIndex]?.window ?? shared.window;
    onChange();
  });
  return () => {
    const { window: shown } = shared;
    const own = shown ? `Level ${valueText(shown.level)}, width ${valueText(shown.width)}` : "";
    const names = [...windows().map(({ name }) => name), own];
    if (names.join() !== [...select.options].map(({ text }) => text).join()) {
      select.replaceChildren(...names.map((name) => make("option", {}, name)));
    }
    const place = windows().findIndex(({ window }) => JSON.stringify(window) === JSON.stringify(shown));
    select.selectedIndex = place >= 0 ? place : names.length - 1;
    select.options[names.length - 1].hidden = place >= 0;
  };
}

export function showSlices(state: State, copy: VolumeCopy): void {
  const section = find("slices");
  const follow = find<HTMLInputElement>("slices-follow");
  const shared: Shared = { position: [0, 0, 0], window: null, drags: find("slices-drag") };
  let version = 0;
  let begun = "";
  // Another volume begins in its middle, with a window of its own; the first one where the link says.
  const begin = () => {
    const { volume } = state;
    const { shape, factor } = copy;
    // The copy may still be that of the volume before.
    if (!shape || !volume || volume.size.some((n, axis) => Math.ceil(n / factor) !== shape.size[axis])) return;
    const name = JSON.stringify([volume.name, volume.size, volume.unit, shape.valueMin, shape.valueMax]);
    if (begun === name) return;
    begun = name;
    for (const view of views) view.showAll();
    shared.position = volume.size.map((n, axis) => clamp(state.view.cross?.[axis] ?? (n - 1) / 2, 0, n - 1)) as Vec3;
    shared.window = windowsOf(volume)[0].window;
  };
  const request = paced(20, () => {
    if (section.hidden || !copy.shape) return;
    begin();
    showWindow();
    const map = state.placement?.deviceFromIndex;
    if (follow.checked && state.pose && map) shared.position = apply(inverse(map), state.pose.scpHMm);
    for (const view of views) view.draw(version);
  });
  const keepCross = () => state.setView({ cross: follow.checked ? null : [...shared.position] });
  const onMove = () => {
    follow.checked = false;
    keepCross();
  };
  const showWindow = showWindows(state, shared, request);
  const sections = () => sectionsOf(patientFrame(state.volume, state.placement) ?? kNoFrame);
  const views = sections().map((s) => new SliceView(s, state, copy, shared, onMove, request));
  find("slices-planes").append(...views.map((view) => view.element));

  follow.addEventListener("change", keepCross);
  state.on(["pose", "settings"], request);
  state.on("copyProgress", () => {
    ++version;
    request();
  });
  state.on(["volume", "placement"], () => {
    sections().forEach((s, n) => (views[n].section = s));
    request();
  });
  state.watch(["view", "picture"], () => {
    section.hidden = !state.view.slices && state.whyNoPicture === "";
    request();
  });
  new ResizeObserver(request).observe(section);
}
