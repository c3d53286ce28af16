// How the three slices lie in the volume. Of a patient they are axial, coronal and sagittal, seen as radiologists
// do: from the feet, from the front, and from the patient's left.
//
// Frames: I (voxels), W (mm; LPS of a patient).

export type Axis = 0 | 1 | 2;
export interface SignedAxis {
  axis: Axis;
  sign: 1 | -1;
}

export interface Section {
  name: string;
  across: SignedAxis; // of I, as the next two
  right: SignedAxis;
  down: SignedAxis;
  letters: { right: string; left: string; down: string; up: string } | null; // of a patient
}

// Directions in W.
const kInWorld: { name: string; across: SignedAxis; right: SignedAxis; down: SignedAxis }[] = [
  { name: "axial", across: { axis: 2, sign: 1 }, right: { axis: 0, sign: 1 }, down: { axis: 1, sign: 1 } },
  { name: "coronal", across: { axis: 1, sign: 1 }, right: { axis: 0, sign: 1 }, down: { axis: 2, sign: -1 } },
  { name: "sagittal", across: { axis: 0, sign: 1 }, right: { axis: 1, sign: 1 }, down: { axis: 2, sign: -1 } },
];
const kOrders: [Axis, Axis, Axis][] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

function letterOf({ axis, sign }: SignedAxis): string {
  return (sign > 0 ? "LPS" : "RAI")[axis];
}

function opposite({ axis, sign }: SignedAxis): SignedAxis {
  return { axis, sign: sign > 0 ? -1 : 1 };
}

// The axes of I along the x, y and z of W: of all assignments that with the greatest sum of cosines. Spacings
// must not decide, nor rounding where two are equal.
export function nearestAxes(worldFromIndex: number[]): SignedAxis[] {
  const cosine = (row: number, column: number) =>
    worldFromIndex[4 * row + column] / Math.hypot(...[0, 1, 2].map((r) => worldFromIndex[4 * r + column]));
  let best = kOrders[0];
  let bestSum = -1;
  for (const order of kOrders) {
    const sum = order.reduce<number>((total, axis, row) => total + Math.abs(cosine(row, axis)), 0);
    if (sum <= bestSum + 1e-6) continue;
    best = order;
    bestSum = sum;
  }
  return best.map((axis, row) => ({ axis, sign: cosine(row, axis) < 0 ? -1 : 1 }));
}

// `worldFromIndex`: rows of the 3×4 map, null if the volume is of no patient.
export function sectionsOf(worldFromIndex: number[] | null): Section[] {
  const axes = worldFromIndex ? nearestAxes(worldFromIndex) : null;
  const inVolume = (direction: SignedAxis): SignedAxis => {
    if (!axes) return direction;
    return direction.sign > 0 ? axes[direction.axis] : opposite(axes[direction.axis]);
  };
  return kInWorld.map(({ name, across, right, down }) => ({
    name: axes ? name : "xyz"[across.axis],
    across: inVolume(across),
    right: inVolume(right),
    down: inVolume(down),
    letters: axes && {
      right: letterOf(right), left: letterOf(opposite(right)), down: letterOf(down), up: letterOf(opposite(down)),
    },
  }));
}

type Point = [number, number, number];

// Applies the inverse of the 3×4 map (rows) to a point.
export function applyInverse(map: number[], point: Point): Point {
  const [a, b, c, , d, e, f, , g, h, i] = map;
  const [x, y, z] = [point[0] - map[3], point[1] - map[7], point[2] - map[11]];
  const determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  return [
    ((e * i - f * h) * x + (c * h - b * i) * y + (b * f - c * e) * z) / determinant,
    ((f * g - d * i) * x + (a * i - c * g) * y + (c * d - a * f) * z) / determinant,
    ((d * h - e * g) * x + (b * g - a * h) * y + (a * e - b * d) * z) / determinant,
  ];
}

// Edges of a voxel in mm, from a 3×4 map's columns.
export function voxelEdges(map: number[]): Point {
  return [0, 1, 2].map((column) => Math.hypot(map[column], map[4 + column], map[8 + column])) as Point;
}
