// Small functions over the DOM. Text is only ever set as text, never as HTML: names of volumes and
// users come from outside.

type Attributes = Record<string, string | number>;

function fill<E extends Element>(element: E, attributes: Attributes, children: (Node | string)[]): E {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

export function make<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag, attributes: Attributes = {}, ...children: (Node | string)[]
): HTMLElementTagNameMap[Tag] {
  return fill(document.createElement(tag), attributes, children);
}

export function makeSvg<Tag extends keyof SVGElementTagNameMap>(
  tag: Tag, attributes: Attributes = {}, ...children: Node[]
): SVGElementTagNameMap[Tag] {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

// The element of index.html with this id.
export function find<T extends HTMLElement = HTMLElement>(id: string): T {
  const element = document.querySelector<T>(`#${id}`);
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
    isDue = nowMs - lastMs < 1000 / perSecond - 4; // frames come a little early or late
    if (isDue) return void requestAnimationFrame(onFrame);
    lastMs = nowMs;
    draw();
  };
  return () => {
    if (!isDue) requestAnimationFrame(onFrame);
    isDue = true;
  };
}

// Fits the canvas's pixels to the screen's and clears it. Units of drawing are CSS pixels, the font is the
// page's. Null: the canvas is not shown.
export function beginDrawing(canvas: HTMLCanvasElement): CanvasRenderingContext2D | null {
  const { clientWidth, clientHeight } = canvas;
  const context = canvas.getContext("2d");
  if (!context || clientWidth === 0 || clientHeight === 0) return null;
  const scale = window.devicePixelRatio;
  const [width, height] = [clientWidth, clientHeight].map((n) => Math.round(n * scale));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, clientWidth, clientHeight);
  const style = getComputedStyle(canvas);
  context.font = `${0.8 * parseFloat(style.fontSize)}px ${style.fontFamily}`;
  return context;
}
