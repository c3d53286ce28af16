// `palpate place`: the volume's place in the device's workspace.
//
// Frame D (mm, x right, y up, z towards the user). Threads: main only, but any for the pure
// functions. Apart for its tests.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "client/cli/invocation.h"
#include "client/cli/json.h"

namespace palpate::cli {

// Pure functions:

// Returns lines that end with \n.
std::string Describe(const client::Placement& placement);
Json PlacementJson(const client::Placement& placement);
// Parses an axis of the device and degrees: "x,90", "y,-7.5". Returns none for any other text.
std::optional<client::UnalignedQuaternion> ParseTurn(std::string_view text);

}  // namespace palpate::cli
