// A mark on a scale of values that users drag or move by keys: a slider of ARIA.
import { make, setAttribute } from "./dom";
import { valueText } from "./words";

export interface Scale {
  low: number;
  high: number;
  isWhole: boolean; // values of whole numbers: keys go by whole steps
  unit: string;
}

export function shareOf(scale: Scale, value: number): number {
  return scale.high > scale.low ? Math.min(1, Math.max(0, (value - scale.low) / (scale.high - scale.low))) : 0;
}

// A value to show and to send: no more digits than one can aim at.
function rounded(scale: Scale, value: number): number {
  const inside = Math.min(scale.high, Math.max(scale.low, value));
  if (scale.isWhole) return Math.round(inside);
  const digits = Math.max(0, 3 - Math.floor(Math.log10(scale.high - scale.low || 1)));
  return Number(inside.toFixed(Math.min(12, digits)));
}

export class Handle {
  readonly element: HTMLElement;
  private value: number | null = null;
  private scale: Scale = { low: 0, high: 1, isWhole: false, unit: "" };

  constructor(
    private readonly box: HTMLElement,
    mark: "isovalue" | "veil",
    label: string,
    private readonly move: (value: number) => void,
  ) {
    const names = { "data-mark": mark, "aria-label": label, title: label };
    this.element = make("div", { class: "handle", role: "slider", tabindex: 0, ...names });
    box.append(this.element);
    this.element.addEventListener("keydown", (event) => this.onKey(event));
    this.element.addEventListener("pointerdown", (event) => this.beginDrag(event));
  }

  // `value` null: there is no mark to move.
  show(scale: Scale, value: number | null): void {
    this.scale = scale;
    this.value = value;
    this.element.hidden = value === null;
    if (value === null) return;
    this.element.style.left = `${100 * shareOf(scale, value)}%`;
    setAttribute(this.element, "aria-valuemin", String(scale.low));
    setAttribute(this.element, "aria-valuemax", String(scale.high));
    setAttribute(this.element, "aria-valuenow", String(value));
    setAttribute(this.element, "aria-valuetext", valueText(value, scale.unit));
  }

  // Follows the pointer from now on until it is released.
  beginDrag(event: PointerEvent): void {
    if (event.button !== 0 || this.element.hidden) return;
    event.preventDefault();
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    const follow = (moved: PointerEvent) => this.moveTo(moved.clientX);
    const end = () => {
      this.element.removeEventListener("pointermove", follow);
      this.element.removeEventListener("lostpointercapture", end);
    };
    this.element.addEventListener("pointermove", follow);
    this.element.addEventListener("lostpointercapture", end);
    if (event.target !== this.element) this.moveTo(event.clientX);
  }

  private moveTo(clientX: number): void {
    const area = this.box.getBoundingClientRect();
    const share = (clientX - area.left) / area.width;
    this.move(rounded(this.scale, this.scale.low + share * (this.scale.high - this.scale.low)));
  }

  private onKey(event: KeyboardEvent): void {
    if (this.value === null) return;
    const { low, high, isWhole } = this.scale;
    const step = Math.max(isWhole ? 1 : 0, (high - low) / 200) * (event.shiftKey && !isWhole ? 0.1 : 1);
    const targets: Record<string, number> = {
      ArrowLeft: this.value - step, ArrowDown: this.value - step,
      ArrowRight: this.value + step, ArrowUp: this.value + step,
      PageDown: this.value - 10 * step, PageUp: this.value + 10 * step,
      Home: low, End: high,
    };
    const target = targets[event.key];
    if (target === undefined) return;
    event.preventDefault();
    this.move(rounded(this.scale, target));
  }
}
