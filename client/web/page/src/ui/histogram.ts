// The histogram with the isovalue, which is everybody's, and the veil, which is this page's. Users who may
// steer the isovalue drag its mark.
import type { State } from "../state";
import type { SuggestedIsovalue } from "../wire/messages";
import type { Room } from "../wire/room";
import { beginDrawing, color, font, make, paced, setText } from "./dom";
import { Handle, shareOf } from "./handle";
import type { Scale } from "./handle";
import { niceStep } from "./plots";
import { Steered } from "./steered";
import { lastChangeText, valueText } from "./words";

const kAxisPx = 20; // as .handle's bottom in style.css

function scaleOf(state: State): Scale | null {
  const { volume } = state;
  if (volume?.value_min === undefined || volume.value_max === undefined) return null;
  return {
    low: volume.histogram?.low ?? volume.value_min,
    high: volume.histogram?.high ?? volume.value_max,
    isWhole: volume.voxel_type !== "float32" && volume.value_max - volume.value_min >= 20,
    unit: volume.unit ?? "",
  };
}

export function isovalueOf(state: State): number | null {
  const value = state.settings?.values["isovalue"];
  return typeof value === "number" ? value : (state.pose?.isovalue ?? null);
}

// Bars are logarithmic, so that a thin skin is as visible as the air around it.
function draw(canvas: HTMLCanvasElement, state: State, scale: Scale, isovalue: number | null): void {
  const context = beginDrawing(canvas);
  const histogram = state.volume?.histogram;
  if (!context) return;
  const width = canvas.clientWidth;
  const bottom = canvas.clientHeight - kAxisPx;
  const x = (value: number) => width * shareOf(scale, value);
  if (histogram && histogram.counts.length > 0) {
    const { low, high, counts } = histogram;
    const greatest = Math.log1p(Math.max(...counts)) || 1;
    const bin = (high - low) / counts.length;
    const isAbove = state.pose?.freeAbove ?? false;
    const colors = { material: color("material"), air: color("air") };
    counts.forEach((count, index) => {
      const value = low + (index + 0.5) * bin;
      const isMaterial = isovalue !== null && (isAbove ? value <= isovalue : value >= isovalue);
      const height = (Math.log1p(count) / greatest) * (bottom - 8);
      // Whole pixels: no seams between bars.
      const left = Math.floor(x(low + index * bin));
      const right = Math.max(left + 1, Math.floor(x(low + (index + 1) * bin)));
      context.fillStyle = isMaterial ? colors.material : colors.air;
      context.fillRect(left, bottom - height, right - left, height);
    });
  }
  context.fillStyle = color("accent");
  for (const { isovalue: at } of state.volume?.suggested ?? []) {
    context.beginPath();
    context.moveTo(x(at) - 4, bottom + 5);
    context.lineTo(x(at), bottom);
    context.lineTo(x(at) + 4, bottom + 5);
    context.fill();
  }
  if (isovalue !== null) {
    context.fillStyle = color("isovalue");
    context.fillRect(x(isovalue) - 1, 0, 2, bottom);
  }
  context.strokeStyle = color("edge");
  context.strokeRect(0, bottom + 0.5, width, 0);
  context.fillStyle = color("dim");
  context.font = font(canvas);
  context.textBaseline = "bottom";
  const step = niceStep((scale.high - scale.low) / 5);
  for (let tick = Math.ceil(scale.low / step) * step; tick <= scale.high; tick += step) {
    const text = valueText(Math.abs(tick) < step / 1e6 ? 0 : tick);
    const half = context.measureText(text).width / 2;
    context.fillText(text, Math.min(width - 2 * half, Math.max(0, x(tick) - half)), canvas.clientHeight);
  }
}

// Where the veil begins: the suggestion that is farthest below the isovalue, or half way down.
function initialVeil(state: State, scale: Scale): number {
  const isovalue = isovalueOf(state) ?? scale.high;
  const beside = 0.01 * (scale.high - scale.low);
  const below = (state.volume?.suggested ?? []).map((s) => s.isovalue).filter((v) => v < isovalue - beside);
  const value = below.length > 0 ? Math.min(...below) : (scale.low + isovalue) / 2;
  return scale.isWhole ? Math.round(value) : value;
}

export function toggleVeil(state: State): void {
  const scale = scaleOf(state);
  if (!scale) return;
  state.view.veil = state.view.veil === null ? initialVeil(state, scale) : null;
  state.emit("view");
}

export function showHistogram(body: HTMLElement, state: State, room: Room): void {
  const maySteer = () => state.hello?.may_steer.includes("isovalue") ?? false;
  const setVeil = (value: number) => {
    state.view.veil = value;
    state.emit("view");
  };

  const empty = make("p", { class: "note" }, "No volume yet.");
  const canvas = make("canvas", { role: "img", "aria-label": "Histogram of the volume's values" });
  const box = make("div", { class: "histogram" }, canvas);
  const value = make("strong");
  const who = make("span", { class: "note" });
  const error = make("p", { class: "error", role: "alert" });
  const typed = make("input", { type: "number", step: "any", "aria-label": "Isovalue, for everyone" });
  const suggestions = make("div", { class: "suggestions" });
  const veilOn = make("input", { type: "checkbox" });
  const veilValue = make("strong", { class: "veil" });
  const opacity = make("input", { type: "range", min: 0.05, max: 0.9, step: 0.05 });
  const opacityField = make("label", { class: "field" }, "Opacity of the veil", opacity);
  const isovalueLine = make("div", { class: "reading" }, "Isovalue ", typed, value, who);
  const veilLabel = make("label", { class: "check" }, veilOn, "Veil (V), only here");
  const veilLine = make("div", { class: "reading" }, veilLabel, veilValue);
  body.append(empty, box, isovalueLine, error, suggestions, veilLine, opacityField);

  const steered = new Steered((v) => room.steer("isovalue", v), (why) => {
    setText(error, why);
    update();
  });
  const setIsovalue = (v: number) => {
    steered.set(v);
    update();
  };
  const isovalueHandle = new Handle(box, "isovalue", "Isovalue, for everyone", setIsovalue);
  const veilHandle = new Handle(box, "veil", "Veil, only on this page", setVeil);

  const requestDrawing = paced(20, () => {
    const scale = scaleOf(state);
    if (scale) draw(canvas, state, scale, steered.own ?? isovalueOf(state));
  });
  const update = () => {
    const scale = scaleOf(state);
    empty.hidden = scale !== null;
    for (const part of Array.from(body.children).slice(1)) (part as HTMLElement).hidden = scale === null;
    if (!scale) return;
    const isovalue = steered.own ?? isovalueOf(state);
    const { veil } = state.view;
    isovalueHandle.show(scale, maySteer() ? isovalue : null);
    veilHandle.show(scale, veil);
    setText(value, maySteer() ? scale.unit : isovalue === null ? "–" : valueText(isovalue, scale.unit));
    setText(who, steered.own !== null ? "setting…" : lastChangeText(state.steering, "isovalue"));
    typed.hidden = !maySteer();
    if (document.activeElement !== typed && isovalue !== null) typed.value = String(isovalue);
    veilOn.checked = veil !== null;
    setText(veilValue, veil === null ? "" : valueText(veil, scale.unit));
    opacity.value = String(state.view.veilOpacity);
    opacityField.hidden = veil === null;
    requestDrawing();
  };
  // Guests put the veil at a suggestion, users who may steer the isovalue.
  const updateSuggestions = () => {
    const unit = state.volume?.unit ?? "";
    const suggestion = ({ name, isovalue, reason }: SuggestedIsovalue) => {
      const title = `${maySteer() ? "Isovalue" : "Veil"} at ${name}, ${valueText(isovalue, unit)}`;
      const made = make("button", { type: "button", title, "aria-label": title }, `${name} ${valueText(isovalue)}`);
      made.addEventListener("click", () => (maySteer() ? setIsovalue(isovalue) : setVeil(isovalue)));
      return make("p", { class: "reading" }, made, make("span", { class: "note" }, reason));
    };
    suggestions.replaceChildren(...(state.volume?.suggested ?? []).map(suggestion));
    update();
  };

  typed.addEventListener("change", () => {
    if (typed.value !== "" && Number.isFinite(typed.valueAsNumber)) setIsovalue(typed.valueAsNumber);
  });
  typed.addEventListener("blur", update); // palpated's value is back if it refused the typed one
  veilOn.addEventListener("change", () => toggleVeil(state));
  opacity.addEventListener("input", () => {
    state.view.veilOpacity = opacity.valueAsNumber;
    state.emit("view");
  });
  // Beside the marks, a press takes the veil there: it disturbs nobody.
  box.addEventListener("pointerdown", (event) => {
    if (event.target === canvas) veilHandle.beginDrag(event);
  });
  let isovalueSeen: number | null = null;
  state.on("pose", () => {
    if (state.settings || state.pose?.isovalue === isovalueSeen) return;
    isovalueSeen = state.pose?.isovalue ?? null;
    update();
  });
  for (const topic of ["settings", "steering", "view"] as const) state.on(topic, update);
  for (const topic of ["volume", "hello"] as const) state.on(topic, updateSuggestions);
  new ResizeObserver(requestDrawing).observe(canvas);
  updateSuggestions();
}
