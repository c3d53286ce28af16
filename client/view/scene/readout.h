// Words for a value and a place of the volume.
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
// "L 12.3 P 4.5 S 60.1 mm" of a patient, otherwise "x 12.3 y -4.5 z 60.1 mm".
std::string PlaceText(const Vec3& p_P, bool of_patient);

// The length in D, in mm, of one mm of the volume. 1 if the volume's place is not known.
double DeviceMmPerMm(const ViewVolume& volume);

}  // namespace palpate::view
