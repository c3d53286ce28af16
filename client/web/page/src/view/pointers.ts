// The mouse and the fingers that are down on an element, and how they move the camera.
import type { State } from "../state";
import { changeCamera } from "./look";

const kOrbitDegPerPx = 0.4;
const kZoomPerStep = 1.15;
const kWheelStep = 100; // pixels
const kLinePx = 33;

export interface Drag {
  right: number; // of the middle of all fingers, CSS pixels
  down: number;
  spread: number; // how much farther apart the fingers are, as a factor
}

export class Pointers {
  hadSeveral = false; // fingers at once, since there was none
  private readonly places = new Map<number, [number, number]>();

  // `down` is called after each pointerdown.
  constructor(element: HTMLElement, down: (event: PointerEvent) => void) {
    element.style.touchAction = "none";
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this.hadSeveral = this.places.size > 0;
      this.places.set(event.pointerId, [event.clientX, event.clientY]);
      down(event);
    });
    for (const name of ["pointerup", "pointercancel"] as const) {
      element.addEventListener(name, (event) => this.places.delete(event.pointerId));
    }
    element.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  // Of a pointermove. Null: nothing is dragged.
  drag(event: PointerEvent): Drag | null {
    if (!this.places.has(event.pointerId)) return null;
    const [[x, y], apart] = [this.middle(), this.spread()];
    this.places.set(event.pointerId, [event.clientX, event.clientY]);
    const [toX, toY] = this.middle();
    return { right: toX - x, down: toY - y, spread: apart > 0 ? this.spread() / apart : 1 };
  }

  private middle(): number[] {
    const all = [...this.places.values()];
    return [0, 1].map((axis) => all.reduce((sum, place) => sum + place[axis], 0) / all.length);
  }

  private spread(): number {
    const [a, b] = [...this.places.values()];
    return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
  }
}

// Steps of the wheel towards the user.
export function wheelSteps(event: WheelEvent): number {
  return (event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY : event.deltaY * kLinePx) / kWheelStep;
}

// As the desktop viewer does: drag to turn, with the right button, Shift or two fingers to move, wheel or pinch to
// come closer.
export function followPointers(canvas: HTMLCanvasElement, state: State): void {
  const pointers = new Pointers(canvas, () => {});
  canvas.addEventListener("pointermove", (event) => {
    const drag = pointers.drag(event);
    if (!drag) return;
    const pans = pointers.hadSeveral || event.shiftKey || (event.buttons & 6) !== 0;
    if (pans) state.view.follow = false;
    changeCamera(state, (camera) => {
      if (pans) camera.pan(drag.right, drag.down, [canvas.clientWidth, canvas.clientHeight]);
      else camera.orbit(-kOrbitDegPerPx * drag.right, kOrbitDegPerPx * drag.down);
      camera.zoom(drag.spread);
    });
  });
  const zoom = (event: WheelEvent) => {
    event.preventDefault();
    changeCamera(state, (camera) => camera.zoom(kZoomPerStep ** -wheelSteps(event)));
  };
  canvas.addEventListener("wheel", zoom, { passive: false });
}
