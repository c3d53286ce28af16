// Where a patient faces in W, as people answer it for a file that states no orientation.
//
// Frame: W world (mm). Threads: pure functions.
#pragma once

#include <string>
#include <string_view>

#include "common/contract/registration.h"

namespace palpate {

// Returns axes as in VolumeMetadata::patient_axes. Left follows from the two directions: the file
// is taken as not mirrored. Throws Error (kInvalidArgument) for other words, or both along one
// axis.
std::string PatientAxesOf(const PatientFacing& facing);

// True for what PatientAxesOf can return.
bool IsAnsweredAxes(std::string_view axes);

}  // namespace palpate
