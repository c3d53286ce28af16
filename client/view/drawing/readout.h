// Words and sizes for people: values and places of the volume, lengths in a picture.
//
// Frame: W (mm). Threads: pure functions.
#pragma once

#include <string>

#include "client/view/volume/view_volume.h"

namespace palpate::view {

// "41 HU"; values between voxels with a decimal.
std::string ValueText(double value, const VolumeLattice& lattice);
// An end of a window of this width, without digits that do not matter.
std::string WindowText(double value, double width);
// A place in mm as it matters beside voxels of this length: at least to 0.1 mm.
struct PlaceDigits {
  double voxel_mm = 1.0;

  int after_point() const;
  double Rounded(double at_mm) const;  // and never -0
};
PlaceDigits PlaceDigitsOf(const AffineMap& X_WI);

// "L 12.3 P 4.5 S 60.1 mm" of a patient, otherwise "x 12.3 y -4.5 z 60.1 mm".
std::string PlaceText(const Vec3& p_P, bool of_patient, const PlaceDigits& digits);

// The length in D, in mm, of one mm of the volume. 1 if the volume's place is not known.
double DeviceMmPerMm(const ViewVolume& volume);

// A bar of a round length, so that sizes in a picture can be read.
struct ScaleBar {
  double length_mm = 0.0;  // 1, 2 or 5 times a power of ten; 0: none
  double length_px = 0.0;
};

// The longest bar of at most `most_px`.
ScaleBar FitScaleBar(double mm_per_px, double most_px);
// "50 mm", "0.02 mm".
std::string TextOf(const ScaleBar& bar);

}  // namespace palpate::view
