// What is drawn over a slice: the cross-hair, the names of the directions, a scale bar. Lengths are CSS pixels.
import type { Section } from "./sections";

const kCrossColor = "#7fe0d0"; // slices are dark in both themes
const kGap = 6; // the cross-hair is open at its point
const kEdge = 9;
const kLongestBarShare = 0.3; // of the picture's width

function write(context: CanvasRenderingContext2D, text: string, x: number, y: number): void {
  context.lineWidth = 3;
  context.strokeStyle = "#000";
  context.fillStyle = "#fff";
  context.textBaseline = "middle";
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

export function drawCross(context: CanvasRenderingContext2D, x: number, y: number): void {
  const { clientWidth: width, clientHeight: height } = context.canvas;
  context.strokeStyle = kCrossColor;
  context.lineWidth = 1;
  context.beginPath();
  for (const [x0, y0, x1, y1] of [[0, y, x - kGap, y], [x + kGap, y, width, y], [x, 0, x, y - kGap], [x, y + kGap, x, height]]) {
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
  }
  context.stroke();
}

export function drawLabels(context: CanvasRenderingContext2D, labels: Section["labels"]): void {
  const { clientWidth: width, clientHeight: height } = context.canvas;
  context.textAlign = "left";
  write(context, labels.left, kEdge / 2, height / 2);
  context.textAlign = "right";
  write(context, labels.right, width - kEdge / 2, height / 2);
  context.textAlign = "center";
  write(context, labels.up, width / 2, kEdge);
  write(context, labels.down, width / 2, height - kEdge);
}

// The longest of 1, 2, 5, 10 ... mm that fits.
export function drawScaleBar(context: CanvasRenderingContext2D, pxPerMm: number): void {
  const { canvas } = context;
  const mostMm = (kLongestBarShare * canvas.clientWidth) / pxPerMm;
  const decade = 10 ** Math.floor(Math.log10(mostMm));
  const lengthMm = decade * (mostMm >= 5 * decade ? 5 : mostMm >= 2 * decade ? 2 : 1);
  const [end, y] = [canvas.clientWidth - 8, canvas.clientHeight - 8];
  context.fillStyle = "#fff";
  context.fillRect(end - lengthMm * pxPerMm, y, lengthMm * pxPerMm, 2);
  context.textAlign = "right";
  write(context, `${Number(lengthMm.toPrecision(1))} mm`, end, y - 9);
  canvas.dataset.scaleBar = `${lengthMm} ${lengthMm * pxPerMm}`; // for tests and scripts
}
