// `palpate place`: the volume's place in the device's workspace.
//
// Frame D (mm, x right, y up, z towards the user). Threads: main only, but any for the pure
// functions.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "client/cli/invocation.h"
#include "client/cli/json.h"
#include "common/geometry/geometry.h"

namespace palpate::cli {

// Pure functions:

// Returns lines that end with \n.
std::string Describe(const client::Placement& placement);
Json PlacementJson(const client::Placement& placement);
// Parses an axis of the device and degrees: "x,90", "y,-7.5". Returns none for any other text.
std::optional<client::UnalignedQuaternion> ParseTurn(std::string_view text);
// Parses a place as viewers show it, "R 60 A 97 S 12" with or without " mm". Returns it in the
// patient's LPS, mm. Throws UsageError.
Vec3 PatientPlace(const std::string& text);
// The same place in W. `axes`: where +x, +y and +z of W point in the patient, such as "LPS". Throws
// Error (kFailedPrecondition) if they are not known.
Vec3 WorldOf(const Vec3& p_P, const std::string& axes);

}  // namespace palpate::cli
