// The histogram with the isovalue, which is everybody's, and the veil, which is this page's. Users who may
// steer the isovalue drag its mark.
import type { State } from "../state";
import { clamp } from "../view/geometry";
import { bandOf, isMaterialAbove, layersOf } from "../view/layers";
import type { SuggestedIsovalue } from "../wire/contract";
import type { Room } from "../wire/room";
import { make, makeSvg, setAttribute, setText } from "./dom";
import { niceStep } from "./plots";
import { Steered } from "./steered";
import { kOfReplay, lastChangeText, valueText } from "./words";

interface Scale {
  low: number;
  high: number;
  isWhole: boolean; // values of whole numbers
  unit: string;
}

function shareOf(scale: Scale, value: number): number {
  return scale.high > scale.low ? clamp((value - scale.low) / (scale.high - scale.low), 0, 1) : 0;
}

// A mark on the histogram that users drag, or move by keys. `move` gets no more digits than one can aim at.
function makeMark(name: "isovalue" | "veil", label: string, move: (value: number) => void) {
  const names = { "data-mark": name, "aria-label": label, title: label };
  const mark = make("input", { class: "mark", type: "range", ...names });
  mark.addEventListener("input", () => {
    const digits = 3 - Math.floor(Math.log10(Number(mark.max) - Number(mark.min) || 1));
    move(Number(mark.valueAsNumber.toFixed(mark.step === "1" ? 0 : clamp(digits, 0, 12))));
  });
  // `value` null: there is no mark to move.
  const show = (scale: Scale, value: number | null) => {
    mark.hidden = value === null;
    if (value === null) return;
    Object.assign(mark, { step: scale.isWhole ? "1" : "any", min: String(scale.low), max: String(scale.high), value: String(value) });
    setAttribute(mark, "aria-valuetext", valueText(value, scale.unit));
  };
  return { mark, show };
}

function cssColor(color: number[]): string {
  return `rgb(${color.map((part) => Math.round(255 * part)).join()})`;
}

function scaleOf(state: State): Scale | null {
  const { volume } = state;
  if (!volume) return null;
  return {
    low: volume.histogram?.low ?? volume.valueMin,
    high: volume.histogram?.high ?? volume.valueMax,
    isWhole: volume.type !== "float32" && volume.valueMax - volume.valueMin >= 20,
    unit: volume.unit,
  };
}

// Bars are logarithmic, so that a thin skin is as visible as the air around it.
function outlineOf(counts: number[]): string {
  const greatest = Math.log1p(Math.max(...counts)) || 1;
  return `M0 1${counts.map((count, n) => `V${1 - Math.log1p(count) / greatest}H${n + 1}`).join("")}V1Z`;
}

// At this value of the histogram.
function markAt(scale: Scale, value: number, className: string, text: string): HTMLElement {
  const mark = make("span", { class: className }, text);
  mark.style.left = `clamp(1.25rem, ${100 * shareOf(scale, value)}%, 100% - 1.25rem)`;
  return mark;
}

function axisOf(scale: Scale, suggested: SuggestedIsovalue[]): HTMLElement[] {
  const step = niceStep((scale.high - scale.low) / 5);
  const first = Math.ceil(scale.low / step);
  const ticks = Array.from({ length: Math.floor(scale.high / step) - first + 1 }, (_, n) => (first + n) * step);
  const digits = clamp(-Math.floor(Math.log10(step)), 0, 12);
  return [...ticks.map((value) => markAt(scale, value, "tick", value.toFixed(digits).replace("-", "−"))),
    ...suggested.map(({ isovalue }) => markAt(scale, isovalue, "tick suggested", "▴"))];
}

// Where the veil begins: the suggestion that is farthest below the isovalue, or half way down.
function initialVeil(state: State, scale: Scale): number {
  const isovalue = state.isovalue() ?? scale.high;
  const beside = 0.01 * (scale.high - scale.low);
  const below = (state.volume?.suggestedIsovalues ?? []).map((s) => s.isovalue).filter((v) => v < isovalue - beside);
  const value = below.length > 0 ? Math.min(...below) : (scale.low + isovalue) / 2;
  return scale.isWhole ? Math.round(value) : value;
}

export function toggleVeil(state: State): void {
  const scale = scaleOf(state);
  if (!scale) return;
  state.setView({ veil: state.view.veil === null ? initialVeil(state, scale) : null });
}

export function showHistogram(body: HTMLElement, state: State, room: Room): void {
  const maySteer = () => !state.settings?.replayed && (state.hello?.may_steer.includes("isovalue") ?? false);
  const setVeil = (veil: number) => state.setView({ veil });
  const steered = new Steered(room, "isovalue", () => update());

  const empty = make("p", { class: "note" }, "No volume yet.");
  // What is above and below the isovalue differs in colour.
  const split = [makeSvg("stop"), makeSvg("stop")];
  const bars = makeSvg("path", { fill: "url(#split)" });
  const drawing = makeSvg("svg", { role: "img", "aria-label": "Histogram of the volume's values", preserveAspectRatio: "none" },
    makeSvg("linearGradient", { id: "split" }, ...split), bars);
  const line = make("span", { class: "line-at" });
  const axis = make("div", {});
  const band = make("span", { class: "band" }); // between two layers, where the proxy is
  const layerMarks = make("div", {});
  const layerList = make("ul", { class: "layers", "aria-label": "Layers, felt one behind the other" });
  const box = make("div", { class: "histogram" }, drawing, band, line, layerMarks, axis);
  const value = make("strong");
  const who = make("span", { class: "note" });
  const typed = make("input", { type: "number", step: "any", "aria-label": "Isovalue, for everyone" });
  const suggestions = make("div", { class: "suggestions" });
  const veilOn = make("input", { type: "checkbox" });
  const veilValue = make("strong", { class: "veil" });
  const opacity = make("input", { type: "range", min: 0.05, max: 0.9, step: 0.05 });
  const opacityField = make("label", { class: "field" }, "Opacity of the veil", opacity);
  const isovalueLine = make("div", { class: "reading" }, "Isovalue ", typed, value, who);
  const veilLabel = make("label", { class: "check" }, veilOn, "Veil (V), only here");
  const veilLine = make("div", { class: "reading" }, veilLabel, veilValue);
  body.append(empty, box, layerList, isovalueLine, steered.error, suggestions, veilLine, opacityField);

  const setIsovalue = (v: number) => {
    steered.set(v);
    update();
  };
  // Beside the marks, a press takes the veil there: it disturbs nobody.
  const veilMark = makeMark("veil", "Veil, only on this page", setVeil);
  const isovalueMark = makeMark("isovalue", "Isovalue, for everyone", setIsovalue);
  box.append(veilMark.mark, isovalueMark.mark);

  const update = () => {
    const scale = scaleOf(state);
    empty.hidden = scale !== null;
    for (const part of Array.from(body.children).slice(1)) (part as HTMLElement).hidden = scale === null;
    if (!scale) return;
    const isovalue = state.settings?.replayed ? state.isovalue() : (steered.own ?? state.isovalue());
    const { veil, veilOpacity } = state.view;
    isovalueMark.show(scale, maySteer() ? isovalue : null);
    veilMark.show(scale, veil);
    setText(value, maySteer() ? scale.unit : isovalue === null ? "–" : valueText(isovalue, scale.unit));
    setText(who, state.settings?.replayed ? kOfReplay : steered.own !== null ? "setting…" : lastChangeText(state.steering, "isovalue"));
    typed.hidden = !maySteer();
    if (document.activeElement !== typed && isovalue !== null) typed.value = String(isovalue);
    veilOn.checked = veil !== null;
    setText(veilValue, veil === null ? "" : valueText(veil, scale.unit));
    opacity.value = String(veilOpacity);
    opacityField.hidden = veil === null;
    const layers = layersOf(state);
    const isLayered = layers.length > 0;
    isovalueLine.hidden ||= isLayered; // each layer has its own
    isovalueMark.mark.hidden ||= isLayered;
    layerList.hidden ||= !isLayered;
    layerList.replaceChildren(...layers.map(({ name, isovalue: at, color }) => {
      const swatch = make("span", { class: "swatch" });
      swatch.style.background = cssColor(color);
      return make("li", {}, swatch, `${name} ${valueText(at, scale.unit)}`);
    }));
    layerMarks.replaceChildren(...layers.map(({ isovalue: at, color }) => {
      const mark = make("span", { class: "line-at" });
      mark.style.left = `${100 * shareOf(scale, at)}%`;
      mark.style.background = cssColor(color);
      return mark;
    }));
    showBand(scale);
    const share = `${100 * (isovalue === null ? 0 : shareOf(scale, isovalue))}%`;
    line.hidden = isovalue === null || isLayered;
    line.style.left = share;
    split.forEach((stop, n) => {
      stop.setAttribute("offset", share);
      stop.setAttribute("class", isovalue !== null && (n === 1) === isMaterialAbove(state) ? "material" : "air");
    });
  };
  const showBand = (scale: Scale) => {
    const between = bandOf(state);
    band.hidden = between === null;
    if (!between) return;
    const [low, high] = between.map((value) => 100 * shareOf(scale, value));
    Object.assign(band.style, { left: `${low}%`, width: `${high - low}%` });
  };
  // Guests put the veil at a suggestion, users who may steer the isovalue. Layers have their own.
  let steers = false;
  const updateVolume = () => {
    steers = maySteer() && layersOf(state).length === 0;
    const unit = state.volume?.unit ?? "";
    const suggestion = ({ name, isovalue, reason }: SuggestedIsovalue) => {
      const title = `${steers ? "Isovalue" : "Veil"} at ${name}, ${valueText(isovalue, unit)}`;
      const made = make("button", { type: "button", title, "aria-label": title }, `${name} ${valueText(isovalue)}`);
      made.addEventListener("click", () => (steers ? setIsovalue(isovalue) : setVeil(isovalue)));
      return make("p", { class: "reading" }, made, make("span", { class: "note" }, reason));
    };
    const { suggestedIsovalues: suggested = [], histogram } = state.volume ?? {};
    suggestions.replaceChildren(...suggested.map(suggestion));
    const scale = scaleOf(state);
    drawing.setAttribute("viewBox", `0 0 ${histogram?.counts.length || 1} 1`);
    bars.setAttribute("d", outlineOf(histogram?.counts ?? []));
    axis.replaceChildren(...(scale ? axisOf(scale, suggested) : []));
    update();
  };

  typed.addEventListener("change", () => {
    if (typed.value !== "" && Number.isFinite(typed.valueAsNumber)) setIsovalue(typed.valueAsNumber);
  });
  typed.addEventListener("blur", update); // palpated's value is back if it refused the typed one
  veilOn.addEventListener("change", () => toggleVeil(state));
  opacity.addEventListener("input", () => state.setView({ veilOpacity: opacity.valueAsNumber }));
  let seen = "";
  state.on("pose", () => {
    const now = `${state.isovalue()} ${isMaterialAbove(state)} ${state.pose?.layersPassed}`;
    if (now !== seen) update();
    seen = now;
  });
  state.on(["settings", "steering", "view"], update);
  state.on("settings", () => {
    if (steers !== (maySteer() && layersOf(state).length === 0)) updateVolume();
  });
  state.watch(["volume", "hello"], updateVolume);
}
