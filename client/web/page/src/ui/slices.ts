// Three slices of the page's copy, drawn on the CPU: they work without WebGL2. They go through the proxy, or
// where the user puts them.
import type { State } from "../state";
import type { VolumeCopy } from "../volume/copy";
import type { Vec3 } from "../wire/messages";
import { contour } from "./contour";
import { beginDrawing, color, find, font, make, paced, setAttribute, setText } from "./dom";
import { isovalueOf } from "./histogram";
import { applyInverse, sectionsOf, voxelEdges } from "./sections";
import type { Axis, Section } from "./sections";

// Where the slices are, in voxels of the copy.
interface Cross {
  position: Vec3;
  followsProxy: boolean;
}

// A slice as its picture has it: turned and mirrored.
interface Picture {
  key: string;
  image: HTMLCanvasElement;
  contours: { path: Path2D; color: string }[];
}

// The picture's place on the canvas, in CSS pixels.
interface Frame {
  left: number;
  top: number;
  scaleX: number; // per voxel
  scaleY: number;
}

class SliceView {
  readonly element: HTMLElement;
  section: Section;
  private readonly canvas = make("canvas", { role: "img", "aria-label": "slice" });
  private readonly slider = make("input", { type: "range", min: 0, step: 1 });
  private readonly name = make("span");
  private readonly place = make("span", { class: "note number" });
  private picture: Picture | null = null;

  constructor(section: Section, private readonly state: State, private readonly copy: VolumeCopy,
              private readonly cross: Cross, private readonly onMove: () => void) {
    this.section = section;
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
    const along = { x: (event.clientX - area.left - frame.left) / frame.scaleX, y: (event.clientY - area.top - frame.top) / frame.scaleY };
    this.move({ [right.axis]: this.toVoxel(right, along.x - 0.5), [down.axis]: this.toVoxel(down, along.y - 0.5) });
  }

  private size(axis: Axis): number {
    return this.copy.shape?.size[axis] ?? 0;
  }

  // Between voxels of an axis and pixels of the picture; its own inverse.
  private toVoxel({ axis, sign }: Section["right"], along: number): number {
    const last = this.size(axis) - 1;
    return Math.min(last, Math.max(0, sign > 0 ? along : last - along));
  }

  private frame(): Frame {
    const { right, down } = this.section;
    const map = this.state.placement?.device_from_index;
    const edges = map ? voxelEdges(map) : [1, 1, 1];
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

  // Keeps the picture while nothing of it changed.
  private pictureNow(index: number, version: number): Picture | null {
    const { shape } = this.copy;
    if (!shape) return null;
    const { across, right, down } = this.section;
    const levels = [
      { level: isovalueOf(this.state), color: color("slice-isovalue") },
      { level: this.state.view.veil, color: color("slice-veil") },
    ];
    const key = JSON.stringify([version, index, this.section, levels, shape]);
    if (this.picture?.key === key) return this.picture;
    const plane = this.copy.plane(across.axis, index);
    const [width, height] = [this.size(right.axis), this.size(down.axis)];
    if (plane.values.length !== width * height) return null;
    const values = new Float32Array(width * height);
    const [stepX, stepY] = right.axis < down.axis ? [1, plane.width] : [plane.width, 1];
    for (let y = 0; y < height; ++y) {
      const row = (down.sign > 0 ? y : height - 1 - y) * stepY;
      for (let x = 0; x < width; ++x) values[y * width + x] = plane.values[row + (right.sign > 0 ? x : width - 1 - x) * stepX];
    }
    const image = this.picture?.image ?? document.createElement("canvas");
    image.width = width;
    image.height = height;
    const pixels = new ImageData(width, height);
    const words = new Uint32Array(pixels.data.buffer);
    const perGray = 255 / (shape.valueMax - shape.valueMin || 1);
    for (let at = 0; at < values.length; ++at) {
      const gray = Math.min(255, Math.max(0, (values[at] - shape.valueMin) * perGray)) | 0;
      words[at] = 0xff000000 | (gray * 0x010101);
    }
    image.getContext("2d")!.putImageData(pixels, 0, 0);
    const contours = levels.flatMap(({ level, color: stroke }) =>
      level === null ? [] : [{ path: contour(values, width, height, level), color: stroke }]);
    this.picture = { key, image, contours };
    return this.picture;
  }

  draw(version: number): void {
    const context = beginDrawing(this.canvas);
    const { across, right, down } = this.section;
    const position = this.cross.position[across.axis];
    const index = Math.min(this.size(across.axis) - 1, Math.max(0, Math.round(position)));
    this.describe(index);
    const picture = context && this.pictureNow(index, version);
    if (!picture) return;
    const frame = this.frame();
    context.save();
    context.translate(frame.left, frame.top);
    context.scale(frame.scaleX, frame.scaleY);
    context.drawImage(picture.image, 0, 0);
    context.translate(0.5, 0.5); // voxels are at the middles of their pixels
    context.lineWidth = 1.25 / Math.min(frame.scaleX, frame.scaleY);
    for (const line of picture.contours) {
      context.strokeStyle = line.color;
      context.stroke(line.path);
    }
    context.restore();
    const x = frame.left + (this.toVoxel(right, this.cross.position[right.axis]) + 0.5) * frame.scaleX;
    const y = frame.top + (this.toVoxel(down, this.cross.position[down.axis]) + 0.5) * frame.scaleY;
    this.drawMarks(context, x, y);
  }

  // The cross-hair, open at the point, and the patient's directions.
  private drawMarks(context: CanvasRenderingContext2D, x: number, y: number): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    context.strokeStyle = color("slice-cross");
    context.lineWidth = 1;
    context.beginPath();
    for (const [x0, y0, x1, y1] of [[0, y, x - 6, y], [x + 6, y, width, y], [x, 0, x, y - 6], [x, y + 6, x, height]]) {
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
    }
    context.stroke();
    const { letters } = this.section;
    if (!letters) return;
    context.font = font(this.canvas);
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = "#000";
    context.fillStyle = "#fff";
    for (const [letter, tx, ty] of [
      [letters.left, 9, height / 2], [letters.right, width - 9, height / 2], [letters.up, width / 2, 10], [letters.down, width / 2, height - 9],
    ] as const) {
      context.strokeText(letter, tx, ty);
      context.fillText(letter, tx, ty);
    }
  }

  // Indices of the whole volume, also for the overview.
  private describe(index: number): void {
    const { across, name } = this.section;
    const { factor } = this.copy;
    const title = this.section.letters ? name : `across ${name}`;
    const voxel = index * factor + (factor - 1) / 2;
    const all = (this.state.volume?.size?.[across.axis] ?? 1) - 1;
    setText(this.name, title);
    setText(this.place, `${"xyz"[across.axis]} ${voxel} of ${all}`);
    setAttribute(this.canvas, "aria-label", `Slice ${title} at voxel ${voxel} of ${all}`);
    setAttribute(this.slider, "aria-label", `Place of the slice ${title}`);
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
  const request = paced(15, () => {
    if (section.hidden || !copy.shape) return;
    follow.checked = cross.followsProxy;
    const map = state.placement?.device_from_index;
    if (cross.followsProxy && state.pose && map) {
      const inVolume = applyInverse(map, state.pose.scpH);
      cross.position = inVolume.map((v) => (v - (copy.factor - 1) / 2) / copy.factor) as Vec3;
    }
    for (const view of views) view.draw(version);
  });
  const views = sectionsOf(null).map((s) => new SliceView(s, state, copy, cross, request));
  find(root, "slices-planes").append(...views.map((view) => view.element));

  const show = () => {
    section.hidden = !state.view.slices && state.whyNoPicture === "";
    request();
  };
  const orient = () => {
    const { volume } = state;
    const sections = sectionsOf((volume?.patient && volume.world_from_index) || null);
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
  for (const topic of ["pose", "placement", "settings"] as const) state.on(topic, request);
  state.on("copyProgress", changed);
  state.on("volume", orient);
  new ResizeObserver(request).observe(section);
  orient();
  show();
}
