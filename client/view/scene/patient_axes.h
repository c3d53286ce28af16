// The patient's axes in a volume, whatever the orientation of its voxels.
//
// W is LPS as in DICOM: x to the patient's left, y to posterior, z to superior. Each axis of W gets
// the axis of I that is nearest to it, which is exact unless the volume is oblique. Slices are
// drawn across axes of I, so nothing is resampled; those of an oblique volume are as oblique as it
// is.
//
// Frames: I (voxels), W (mm). Threads: plain values and pure functions.
#pragma once

#include <array>
#include <string_view>

#include "client/sdk/of_patient.h"
#include "common/bricks/volume_event.h"
#include "common/geometry/geometry.h"

namespace palpate::view {

// One of the three axes of a frame, in its own direction (1) or against it (-1).
struct SignedAxis {
  int axis = 0;
  int sign = 1;
  SignedAxis operator-() const { return {axis, -sign}; }
  friend bool operator==(const SignedAxis&, const SignedAxis&) = default;
};

// The axes of I along the x, y and z of W; each axis of I once.
using PatientAxes = std::array<SignedAxis, 3>;
// `W_from_I`: linear part of the volume's map, invertible. Of all assignments, the one with the
// greatest sum of cosines.
PatientAxes NearestAxes(const Mat3& W_from_I);

// How slices show the patient's left.
enum class SliceSide {
  kRadiological,  // at the right: the patient is seen from the feet and from the front
  kNeurological,  // at the left: from the head and from behind
};

// Directions of a slice's picture.
struct SliceAxes {
  SignedAxis across;  // from slice to slice
  SignedAxis right;
  SignedAxis down;
  friend bool operator==(const SliceAxes&, const SliceAxes&) = default;
};

// Directions in W of the slice across x (sagittal), y (coronal) or z (axial). Superior is up, in
// axial slices anterior is. A sagittal slice is seen from the patient's left, with anterior at the
// left, on either side.
SliceAxes SliceInWorld(int world_axis, SliceSide side);
// The same slice's directions in I.
SliceAxes SliceInVolume(int world_axis, SliceSide side, const PatientAxes& axes);

// The letter of a direction of W: L or R, P or A, S or I.
char LetterOf(const SignedAxis& direction_W);

// A look at the patient, in the camera's angles while the patient is upright. From above and from
// below, anterior is up.
struct PatientView {
  std::string_view name;
  double azimuth_deg;
  double elevation_deg;
};
inline constexpr std::array<PatientView, 6> kPatientViews = {{{"anterior", 0.0, 0.0},
                                                              {"posterior", 180.0, 0.0},
                                                              {"left", 90.0, 0.0},
                                                              {"right", -90.0, 0.0},
                                                              {"superior", 180.0, 89.0},
                                                              {"inferior", 0.0, -89.0}}};

// The camera's frame U for which superior is up and anterior is in front. Both maps: linear parts,
// of the same volume, whose placement is a similarity.
Mat3 UprightPatient(const Mat3& D_from_I, const Mat3& W_from_I);

using client::IsOfPatient;

}  // namespace palpate::view
