// The patient's axes in a volume (client/view/drawing/patient_axes.h). P is the patient's frame, LPS: x to the
// patient's left, y to posterior, z to superior. Where it is not known, the axes of the world W stand in for it,
// without letters.
import type { Placement, Volume } from "../wire/contract";
import type { Vec3 } from "../wire/messages";
import { column, compose, cross, dot, fromColumns, normalized, scale } from "./geometry";
import type { AffineMap } from "./geometry";

export type Axis = 0 | 1 | 2;

// An axis of a frame, in its own direction or against it.
export interface SignedAxis {
  axis: Axis;
  sign: 1 | -1;
}

export interface PatientFrame {
  isKnown: boolean;
  fromIndex: AffineMap; // to P, or to W if P is not known
}

export interface FaceLabel extends SignedAxis {
  label: string;
}

// The faces of a box.
export const kFaces = ([0, 1, 2] as Axis[]).flatMap((axis) => ([1, -1] as const).map((sign): SignedAxis => ({ axis, sign })));
const kOrders: Axis[][] = [
  [0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0],
];
// A tie, as of a volume turned by 45°, must not depend on rounding.
const kTie = 1e-6;
// A direction has the letters of its components of at least this share of its length.
const kLeastLetter = Math.sin(Math.PI / 8);
const kObliqueDeg = 2;

export function opposite({ axis, sign }: SignedAxis): SignedAxis {
  return { axis, sign: sign > 0 ? -1 : 1 };
}

// The letter of a direction of P.
export function letterOf({ axis, sign }: SignedAxis): string {
  return (sign > 0 ? "LPS" : "RAI")[axis];
}

// "L 12.3 P 4.5 S 60.1 mm" of a patient, otherwise "x 12.3 y −4.5 z 60.1 mm".
export function placeText(place: Vec3, isKnown: boolean): string {
  const words = place.map((mm, axis) => {
    const rounded = Math.round(10 * mm) / 10 + 0;
    const letter = letterOf({ axis: axis as Axis, sign: rounded < 0 ? -1 : 1 });
    return isKnown ? `${letter} ${Math.abs(rounded).toFixed(1)}` : `${"xyz"[axis]} ${rounded.toFixed(1).replace("-", "−")}`;
  });
  return `${words.join(" ")} mm`;
}

// The letters of any direction of P, the greatest component first: "L", "LA".
export function lettersOf(direction: Vec3): string {
  const unit = normalized(direction);
  const size = (axis: Axis) => Math.abs(unit[axis]);
  const axes = ([0, 1, 2] as Axis[]).sort((a, b) => (Math.abs(size(a) - size(b)) > kTie ? size(b) - size(a) : a - b));
  return axes.filter((axis) => size(axis) >= kLeastLetter)
    .map((axis) => letterOf({ axis, sign: unit[axis] < 0 ? -1 : 1 })).join("");
}

// The turn from W to P; null if `axes` (patient_axes of VolumePlacement) is "" or mirrors.
function patientFromWorld(axes: string): AffineMap | null {
  const columns = [...axes].map((letter) => {
    const part = (axis: number) => Number(letter === "LPS"[axis]) - Number(letter === "RAI"[axis]);
    return [0, 1, 2].map(part) as Vec3;
  });
  if (columns.length !== 3 || dot(cross(columns[0], columns[1]), columns[2]) !== 1) return null;
  return fromColumns(columns[0], columns[1], columns[2], [0, 0, 0]);
}

// Null: there is no volume.
export function patientFrame(volume: Volume | null, placement: Placement | null): PatientFrame | null {
  if (!volume) return null;
  const turn = patientFromWorld(placement?.patientAxes ?? "");
  return { isKnown: turn !== null, fromIndex: turn ? compose(turn, volume.worldFromIndex) : volume.worldFromIndex };
}

// The axes of the voxels along the x, y and z of P. Each axis of P gets the one that is nearest to it.
export function nearestAxes(patientFromIndex: AffineMap): SignedAxis[] {
  const directions = [0, 1, 2].map((axis) => normalized(column(patientFromIndex, axis)));
  let best = kOrders[0];
  let bestSum = 0;
  for (const order of kOrders) {
    const sum = order.reduce<number>((all, ofIndex, axis) => all + Math.abs(directions[ofIndex][axis]), 0);
    if (sum > bestSum + kTie) [best, bestSum] = [order, sum];
  }
  return best.map((axis, world) => ({ axis, sign: directions[axis][world] < 0 ? -1 : 1 }));
}

// What a direction along an axis of the voxels is called: its letters, or the axis of W, such as "+x".
export function labelOf({ isKnown, fromIndex }: PatientFrame, { axis, sign }: SignedAxis): string {
  if (isKnown) return lettersOf(scale(sign, column(fromIndex, axis)));
  const axes = nearestAxes(fromIndex);
  const world = axes.findIndex((nearest) => nearest.axis === axis);
  return (axes[world].sign === sign ? "+" : "−") + "xyz"[world];
}

// The labels beside the faces of the box, towards the last voxel or the first.
export function faceLabels(frame: PatientFrame): FaceLabel[] {
  return kFaces.map((face) => ({ label: labelOf(frame, face), ...face }));
}

// The slice across an axis of P: "axial", or how far its plane is from that one, such as "oblique 31°".
export function planeName(patientFromIndex: AffineMap, world: Axis): string {
  const { axis } = nearestAxes(patientFromIndex)[world];
  const [a, b] = [1, 2].map((n) => column(patientFromIndex, (axis + n) % 3));
  const angleDeg = (Math.acos(Math.min(1, Math.abs(normalized(cross(a, b))[world]))) * 180) / Math.PI;
  return angleDeg > kObliqueDeg ? `oblique ${angleDeg.toFixed(0)}°` : ["sagittal", "coronal", "axial"][world];
}
