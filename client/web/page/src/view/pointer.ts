// Moves the camera by mouse and touch as the desktop viewer does: drag to turn, with the right button, Shift
// or two fingers to move, wheel or pinch to come closer.
import type { Camera, Size } from "./camera";

const kOrbitDegPerPx = 0.4;
const kZoomPerStep = 1.15;
const kWheelStep = 100; // pixels

interface Point {
  x: number;
  y: number;
}

// `size`: of the canvas in CSS pixels. `moved` is called after each change.
export function followPointers(canvas: HTMLCanvasElement, camera: Camera, size: () => Size, moved: (panned: boolean) => void): void {
  const pointers = new Map<number, Point>();
  const centre = (): Point => {
    const all = [...pointers.values()];
    return { x: all.reduce((sum, p) => sum + p.x, 0) / all.length, y: all.reduce((sum, p) => sum + p.y, 0) / all.length };
  };
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  };
  canvas.style.touchAction = "none";
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  const release = (event: PointerEvent) => pointers.delete(event.pointerId);
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const [from, apart] = [centre(), spread()];
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const to = centre();
    const [right, down] = [to.x - from.x, to.y - from.y];
    const pans = pointers.size > 1 || event.shiftKey || (event.buttons & 6) !== 0;
    if (pans) camera.pan(right, down, size());
    else camera.orbit(-kOrbitDegPerPx * right, kOrbitDegPerPx * down);
    if (apart > 0) camera.zoom(spread() / apart);
    moved(pans);
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY : event.deltaY * 33;
      camera.zoom(kZoomPerStep ** (-pixels / kWheelStep));
      moved(false);
    },
    { passive: false },
  );
}
