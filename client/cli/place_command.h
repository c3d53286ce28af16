// `palpate place`: where the volume lies in the device's workspace.
//
// Frame D (mm, x right, y up, z towards the user). Threads: main only, but the pure functions any.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "client/cli/invocation.h"

namespace palpate::cli {

// Pure:

// Lines that end with \n.
std::string Describe(const client::Placement& placement);
nlohmann::ordered_json ToJson(const client::Placement& placement);
// Of "x,90", "y,-7.5": an axis of the device and degrees. None where it is neither.
std::optional<client::UnalignedQuaternion> ParseTurn(std::string_view text);

}  // namespace palpate::cli
