// How the three slices lie in the volume. Of a patient they are axial, coronal and sagittal, seen as radiologists
// do: from the feet, from the front, and from the patient's left. Of other volumes W is the voxels' frame.
import { letterOf, nearestAxes, opposite } from "../view/patient_axes";
import type { SignedAxis } from "../view/patient_axes";

export interface Section {
  name: string;
  across: SignedAxis; // of the voxels, as the next two
  right: SignedAxis;
  down: SignedAxis;
  letters: { right: string; left: string; down: string; up: string } | null; // of a patient
}

// Directions in W.
const kSections: Omit<Section, "letters">[] = [
  { name: "axial", across: { axis: 2, sign: 1 }, right: { axis: 0, sign: 1 }, down: { axis: 1, sign: 1 } },
  { name: "coronal", across: { axis: 1, sign: 1 }, right: { axis: 0, sign: 1 }, down: { axis: 2, sign: -1 } },
  { name: "sagittal", across: { axis: 0, sign: 1 }, right: { axis: 1, sign: 1 }, down: { axis: 2, sign: -1 } },
];

// `worldFromIndex`: null if the volume is of no patient.
export function sectionsOf(worldFromIndex: number[] | null): Section[] {
  if (!worldFromIndex) return kSections.map((s) => ({ ...s, name: `across ${"xyz"[s.across.axis]}`, letters: null }));
  const axes = nearestAxes(worldFromIndex);
  const inVolume = ({ axis, sign }: SignedAxis) => (sign > 0 ? axes[axis] : opposite(axes[axis]));
  return kSections.map(({ name, across, right, down }) => ({
    name,
    across: inVolume(across),
    right: inVolume(right),
    down: inVolume(down),
    letters: {
      right: letterOf(right), left: letterOf(opposite(right)), down: letterOf(down), up: letterOf(opposite(down)),
    },
  }));
}
