// Force, penetration and age of the last 10 s.
import { kHistoryMs } from "../state";
import type { PoseSample, State } from "../state";
import { find, make, makeSvg, paced, setText } from "./dom";
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

const kHeight = 60; // of the drawing, in its units; it is 100 wide
const kGrid = `M0 0H100M0 ${kHeight / 2}H100M0 ${kHeight}H100M50 0V${kHeight}M0 0V${kHeight}M100 0V${kHeight}`;

class Plot {
  readonly element: HTMLElement;
  private readonly now = make("strong");
  private readonly most = make("span", { class: "note" });
  private readonly values = [make("span"), make("span"), make("span")]; // of the axis, from above
  private readonly line = makeSvg("path", { class: "values" });
  private readonly drawing: SVGElement;

  constructor(private readonly kind: PlotKind) {
    this.drawing = makeSvg("svg", { role: "img", viewBox: `0 0 100 ${kHeight}`, preserveAspectRatio: "none" },
      makeSvg("path", { d: kGrid }), this.line);
    const names = make("span", {}, `${kind.label} `, this.now);
    const times = ["−10 s", "−5 s", "now"].map((time) => make("span", {}, time));
    this.element = make("div", { class: "plot" }, make("div", { class: "row" }, names, this.most),
      make("div", { class: "axis" }, ...this.values), this.drawing, make("div", { class: "row times" }, ...times));
  }

  draw(samples: PoseSample[], nowMs: number): void {
    const { member, least } = this.kind;
    const seen = samples.filter((s) => Number.isFinite(s[member]) && nowMs - s.timeMs <= kHistoryMs);
    const step = niceStep(Math.max(least, ...seen.map((s) => s[member])) / 2);
    this.values.forEach((value, n) => setText(value, String(Number(((2 - n) * step).toPrecision(3)))));
    const points = seen.map((sample, n) => {
      const isGap = n === 0 || sample.timeMs - seen[n - 1].timeMs > kGapMs;
      const x = 100 * (1 - (nowMs - sample.timeMs) / kHistoryMs);
      const y = kHeight * (1 - sample[member] / (2 * step));
      return `${isGap ? "M" : "L"}${x.toFixed(2)} ${y.toFixed(2)}`;
    });
    this.line.setAttribute("d", points.join(""));
  }

  // The numbers, also for those who do not see the line.
  describe(samples: PoseSample[]): void {
    const { label, member, digits, unit } = this.kind;
    const values = samples.map((s) => s[member]).filter(Number.isFinite);
    const now = fixed(values.at(-1) ?? NaN, digits, unit);
    const most = fixed(values.length > 0 ? Math.max(...values) : NaN, digits, unit);
    setText(this.now, now);
    setText(this.most, `at most ${most}`);
    this.drawing.setAttribute("aria-label", `${label} of the last 10 s: now ${now}, at most ${most}`);
  }
}

// Returns a function to call several times a second: the plots go on while no poses come.
export function showPlots(state: State): () => void {
  const section = find<HTMLDetailsElement>("plots-section");
  const plots = kPlots.map((kind) => new Plot(kind));
  find("plots").append(...plots.map((plot) => plot.element));
  let describedMs = -Infinity;
  const request = paced(20, () => {
    if (!section.open) return;
    const { samples } = state;
    const nowMs = 1e-6 * (state.pose?.timeNs ?? 0) + state.poseAgeMs();
    for (const plot of plots) plot.draw(samples, nowMs);
    if (performance.now() - describedMs < 500) return;
    describedMs = performance.now();
    for (const plot of plots) plot.describe(samples);
  });
  section.addEventListener("toggle", request);
  state.on("pose", request);
  return request;
}
