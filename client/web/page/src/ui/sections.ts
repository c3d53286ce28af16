// How the three slices lie in the volume. Of a patient they are axial, coronal and sagittal, seen as radiologists
// do: from the feet, from the front, and from the patient's left. Where the sides are not known, the axes of the
// world stand in for the patient's.
import { labelOf, nearestAxes, opposite, planeName } from "../view/patient_axes";
import type { PatientFrame, SignedAxis } from "../view/patient_axes";

export interface Section {
  name: string;
  across: SignedAxis; // of the voxels, as the next two
  right: SignedAxis;
  down: SignedAxis;
  labels: { right: string; left: string; down: string; up: string }; // of the edges
}

// Directions in P.
const kSections: Pick<Section, "across" | "right" | "down">[] = [
  { across: { axis: 2, sign: 1 }, right: { axis: 0, sign: 1 }, down: { axis: 1, sign: 1 } },
  { across: { axis: 1, sign: 1 }, right: { axis: 0, sign: 1 }, down: { axis: 2, sign: -1 } },
  { across: { axis: 0, sign: 1 }, right: { axis: 1, sign: 1 }, down: { axis: 2, sign: -1 } },
];

export function sectionsOf(frame: PatientFrame): Section[] {
  const { isKnown, fromIndex } = frame;
  const axes = nearestAxes(fromIndex);
  const inVolume = ({ axis, sign }: SignedAxis) => (sign > 0 ? axes[axis] : opposite(axes[axis]));
  const label = (direction: SignedAxis) => labelOf(frame, inVolume(direction));
  return kSections.map(({ across, right, down }) => ({
    name: isKnown ? planeName(fromIndex, across.axis) : `across ${"xyz"[across.axis]}`,
    across: inVolume(across),
    right: inVolume(right),
    down: inVolume(down),
    labels: { right: label(right), left: label(opposite(right)), down: label(down), up: label(opposite(down)) },
  }));
}
