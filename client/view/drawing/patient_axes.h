// The patient's axes in a volume, whatever the orientation of its voxels.
//
// P is the patient's frame, LPS as in DICOM: x to the patient's left, y to posterior, z to
// superior. It is W where the file states an orientation, and a turn of W by right angles where
// somebody has answered where the patient faces. Where neither is known, P is W, and its axes have
// no letters. Each axis of P gets the axis of I that is nearest to it, which is exact unless the
// volume is oblique. Slices are drawn across axes of I, so nothing is resampled; those of an
// oblique volume are as oblique as it is, and are called so.
//
// Frames: I (voxels), W, P (mm). Threads: plain values and pure functions.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "client/view/volume/view_volume.h"
#include "common/geometry/geometry.h"

namespace palpate::view {

// One of the three axes of a frame, in its own direction (1) or against it (-1).
struct SignedAxis {
  int axis = 0;
  int sign = 1;
  SignedAxis operator-() const { return {axis, -sign}; }
  friend bool operator==(const SignedAxis&, const SignedAxis&) = default;
};

// The turn from W to P. None if `patient_axes` (VolumePlacement) is empty, or mirrors.
std::optional<Mat3> PatientFromWorld(std::string_view patient_axes);

struct PatientFrame {
  bool is_known = false;  // P is the patient's LPS
  AffineMap X_PI;
};
// Call it only with a lattice.
PatientFrame PatientFrameOf(const ViewVolume& volume);

// The axes of I along the x, y and z of P; each axis of I once. (Or of another frame for P.)
using PatientAxes = std::array<SignedAxis, 3>;
// `P_from_I`: linear part of the volume's map, invertible. Of all assignments, the one with the
// greatest sum of cosines.
PatientAxes NearestAxes(const Mat3& P_from_I);

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

// Directions in P of the slice across x (sagittal), y (coronal) or z (axial). Superior is up, in
// axial slices anterior is. A sagittal slice is seen from the patient's left, with anterior at the
// left, on either side.
SliceAxes SliceInWorld(int world_axis, SliceSide side);
// The same slice's directions in I.
SliceAxes SliceInVolume(int world_axis, SliceSide side, const PatientAxes& axes);

// The letter of a direction of P: L or R, P or A, S or I.
char LetterOf(const SignedAxis& direction_P);
// The letters of any direction of P, such as "L" or "LA": those of its components of at least
// sin 22.5° of its length, the greatest first.
std::string LettersOf(const Vec3& direction_P);

// A slice's plane is called oblique from this angle to the patient's plane on.
inline constexpr double kOblique_deg = 2.0;
// The name of the slice across an axis of P: "axial", "coronal", "sagittal", or such as
// "oblique 31°", the angle between the slice's plane and that plane of the patient.
std::string PlaneName(int patient_axis, const Mat3& P_from_I);

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
Mat3 UprightPatient(const Mat3& D_from_I, const Mat3& P_from_I);

}  // namespace palpate::view
