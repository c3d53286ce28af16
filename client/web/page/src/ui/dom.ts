// Small functions over the DOM. Text is only ever set as text, never as HTML: names of volumes and
// users come from outside.

type Attributes = Record<string, string | number | boolean>;

export function make<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag, attributes: Attributes = {}, ...children: (Node | string)[]
): HTMLElementTagNameMap[Tag] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== false) element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children);
  return element;
}

// The element of index.html with this id.
export function find<T extends HTMLElement = HTMLElement>(root: HTMLElement, id: string): T {
  const element = root.querySelector<T>(`#${id}`);
  if (!element) throw new Error(`index.html has no element #${id}`);
  return element;
}

// Sets text only where it differs: the layout is not computed again, and nothing is announced twice.
export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

export function setAttribute(element: Element, name: string, value: string): void {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

// Returns a function that asks for `draw`. It runs with the browser's frames, at most this often, and not
// while the page is hidden.
export function paced(perSecond: number, draw: () => void): () => void {
  let isDue = false;
  let lastMs = -Infinity;
  const onFrame = (nowMs: number) => {
    // Frames come a little early or late.
    if (nowMs - lastMs < 1000 / perSecond - 4) {
      requestAnimationFrame(onFrame);
      return;
    }
    isDue = false;
    lastMs = nowMs;
    draw();
  };
  return () => {
    if (isDue) return;
    isDue = true;
    requestAnimationFrame(onFrame);
  };
}

// Fits the canvas's pixels to the screen's and clears it. Units of drawing are CSS pixels. Null: the canvas
// is not shown.
export function beginDrawing(canvas: HTMLCanvasElement): CanvasRenderingContext2D | null {
  const { clientWidth, clientHeight } = canvas;
  const context = canvas.getContext("2d");
  if (!context || clientWidth === 0 || clientHeight === 0) return null;
  const scale = window.devicePixelRatio;
  const width = Math.round(clientWidth * scale);
  const height = Math.round(clientHeight * scale);
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, clientWidth, clientHeight);
  return context;
}

// A colour of style.css in the theme that is shown.
export function color(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// The font of the page, for canvases.
export function font(canvas: HTMLCanvasElement): string {
  const style = getComputedStyle(canvas);
  return `${0.8 * parseFloat(style.fontSize)}px ${style.fontFamily}`;
}
