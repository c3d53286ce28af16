// Where a patient faces in W, as people answer it for a file that states no orientation.
//
// Frame: W world (mm). Threads: pure functions.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

// Directions of W: "+x", "-x", "+y", "-y", "+z" or "-z".
struct PatientFacing {
  std::string face;  // anterior
  std::string head;  // superior
  // Of the volume that was looked at; none: of the present one.
  std::optional<std::uint64_t> loaded_revision{};
};

// Returns axes as in VolumeMetadata::patient_axes. Left follows from the two directions: the file
// is taken as not mirrored. Throws Error (kInvalidArgument) for other words, or both along one
// axis.
std::string PatientAxesOf(const PatientFacing& facing);

// True for what PatientAxesOf can return.
bool IsAnsweredAxes(std::string_view axes);

}  // namespace palpate
