// Force, penetration and age of the last 10 s.
import { PoseHistory } from "../state";
import type { PoseSample, State } from "../state";
import { beginDrawing, color, find, font, make, paced, setAttribute, setText } from "./dom";
import { fixed } from "./words";

interface PlotKind {
  label: string;
  member: Exclude<keyof PoseSample, "timeMs">;
  unit: string;
  digits: number;
  least: number; // the axis reaches at least this far
}

const kPlots: PlotKind[] = [
  { label: "Force", member: "forceN", unit: "N", digits: 2, least: 0.5 },
  { label: "Penetration", member: "penetrationMm", unit: "mm", digits: 2, least: 0.5 },
  { label: "Age", member: "ageMs", unit: "ms", digits: 0, least: 20 },
];
const kGapMs = 500; // a longer silence is a gap in the line

// 1, 2 or 5 times a power of ten, at least `least`.
export function niceStep(least: number): number {
  if (!(least > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(least));
  return power * ([1, 2, 5, 10].find((factor) => factor * power >= least * (1 - 1e-9)) ?? 10);
}

class Plot {
  readonly element: HTMLElement;
  private readonly canvas: HTMLCanvasElement;
  private readonly now = make("strong");
  private readonly most = make("span", { class: "note number" });

  constructor(private readonly kind: PlotKind) {
    this.canvas = make("canvas", { role: "img", "aria-label": `${kind.label} of the last 10 s` });
    const names = make("span", {}, `${kind.label} `, this.now);
    this.element = make("div", { class: "plot" }, make("div", { class: "row" }, names, this.most), this.canvas);
  }

  draw(samples: PoseSample[], nowMs: number): void {
    const context = beginDrawing(this.canvas);
    if (!context) return;
    const { member } = this.kind;
    let greatest = 0;
    for (const sample of samples) if (Number.isFinite(sample[member])) greatest = Math.max(greatest, sample[member]);
    const step = niceStep(Math.max(greatest, this.kind.least) / 2);
    context.font = font(this.canvas);
    const area = this.drawAxes(context, step);
    const x = (timeMs: number) => area.left + area.width * (1 - (nowMs - timeMs) / PoseHistory.kSpanMs);
    context.strokeStyle = color("plot");
    context.lineWidth = 1.5;
    context.lineJoin = "round";
    context.beginPath();
    let lastMs = -Infinity;
    for (const sample of samples) {
      if (!Number.isFinite(sample[member]) || nowMs - sample.timeMs > PoseHistory.kSpanMs) continue;
      const y = area.bottom - (area.height * sample[member]) / (2 * step);
      if (sample.timeMs - lastMs > kGapMs) context.moveTo(x(sample.timeMs), y);
      else context.lineTo(x(sample.timeMs), y);
      lastMs = sample.timeMs;
    }
    context.stroke();
  }

  private drawAxes(context: CanvasRenderingContext2D, step: number) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const line = parseFloat(context.font) * 1.25;
    const text = (value: number) => String(Number((value * step).toPrecision(3)));
    const left = Math.ceil(Math.max(...[0, 1, 2].map((n) => context.measureText(text(n)).width), line * 1.6)) + 6;
    const area = { left, width: width - left - 1, bottom: height - 1.25 * line, height: height - 1.85 * line };
    context.strokeStyle = color("grid");
    context.fillStyle = color("dim");
    context.textBaseline = "middle";
    context.textAlign = "right";
    for (const n of [0, 1, 2]) {
      const y = Math.round(area.bottom - (area.height * n) / 2) + 0.5;
      context.strokeRect(left, y, area.width, 0);
      context.fillText(text(n), left - 6, y);
    }
    context.textBaseline = "bottom";
    for (const seconds of [10, 5, 0]) {
      const x = left + area.width * (1 - seconds / 10);
      context.textAlign = seconds === 10 ? "left" : seconds === 0 ? "right" : "center";
      context.fillText(seconds === 0 ? "now" : `−${seconds} s`, x, height);
      context.strokeRect(Math.min(width - 0.5, Math.round(x) + 0.5), area.bottom - area.height, 0, area.height);
    }
    return area;
  }

  // The numbers, also for those who do not see the line.
  describe(samples: PoseSample[]): void {
    const { label, member, digits, unit } = this.kind;
    const values = samples.map((s) => s[member]).filter(Number.isFinite);
    const now = fixed(values.at(-1) ?? NaN, digits, unit);
    const most = fixed(values.length > 0 ? Math.max(...values) : NaN, digits, unit);
    setText(this.now, now);
    setText(this.most, `at most ${most}`);
    setAttribute(this.canvas, "aria-label", `${label} of the last 10 s: now ${now}, at most ${most}`);
  }
}

// Returns a function to call several times a second: the plots go on while no poses come.
export function showPlots(root: HTMLElement, state: State): () => void {
  const section = find<HTMLDetailsElement>(root, "plots-section");
  const plots = kPlots.map((kind) => new Plot(kind));
  find(root, "plots").append(...plots.map((plot) => plot.element));
  let describedMs = -Infinity;
  const request = paced(20, () => {
    if (!section.open) return;
    const { samples } = state.poses;
    const nowMs = (state.pose?.timeMs ?? 0) + state.poseAgeMs();
    for (const plot of plots) plot.draw(samples, nowMs);
    if (performance.now() - describedMs < 500) return;
    describedMs = performance.now();
    for (const plot of plots) plot.describe(samples);
  });
  section.addEventListener("toggle", request);
  state.on("pose", request);
  state.on("view", request);
  return request;
}
