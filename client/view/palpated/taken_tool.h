// What stands between a rigid tool and the hand, and the one change that removes it.
//
// Lengths of the device. Threads: pure functions.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/sdk/settings.h"

namespace palpate::view {

struct TakenTool {
  std::vector<std::string> needs;   // what else changes, for people; empty: nothing
  client::SettingsUpdate update{};  // takes the tool, and changes that
  bool is_possible = true;          // else no scale makes its balls fit
  // Of the volume, as another way to make the balls fit; then the tool stays as it is.
  std::optional<double> magnification{};
};

// `voxel_mm`: the shortest edge of a voxel. Of layers, the innermost stays as the one surface.
TakenTool TakeTool(const HeldTool& tool, const client::Settings& now, double voxel_mm);

}  // namespace palpate::view
