// Lines of equal value in a slice, by linear interpolation between voxels.

// Pairs of a cell's edges that a line joins, for each set of corners at or above the value: bit 0 upper left,
// 1 upper right, 2 lower right, 3 lower left. Edges: 0 top, 1 right, 2 bottom, 3 left.
const kLines: number[][] = [
  [], [3, 0], [0, 1], [3, 1], [1, 2], [3, 0, 1, 2], [0, 2], [3, 2],
  [2, 3], [2, 0], [0, 1, 2, 3], [2, 1], [1, 3], [1, 0], [0, 3], [],
];

// Coordinates: voxel (x, y) at (x, y).
export function contour(values: Float32Array, width: number, height: number, level: number): Path2D {
  const path = new Path2D();
  for (let y = 0; y + 1 < height; ++y) {
    for (let x = 0; x + 1 < width; ++x) {
      const at = y * width + x;
      const a = values[at];
      const b = values[at + 1];
      const c = values[at + width + 1];
      const d = values[at + width];
      const lines = kLines[(a >= level ? 1 : 0) + (b >= level ? 2 : 0) + (c >= level ? 4 : 0) + (d >= level ? 8 : 0)];
      for (let n = 0; n < lines.length; ++n) {
        const edge = lines[n];
        const px = edge === 0 ? x + (level - a) / (b - a) : edge === 2 ? x + (level - d) / (c - d) : x + (edge === 1 ? 1 : 0);
        const py = edge === 1 ? y + (level - b) / (c - b) : edge === 3 ? y + (level - a) / (d - a) : y + (edge === 2 ? 1 : 0);
        if (n % 2 === 0) path.moveTo(px, py);
        else path.lineTo(px, py);
      }
    }
  }
  return path;
}
