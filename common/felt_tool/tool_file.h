// Rigid tools in TOML: files that people write, and the session's file.
//
//   name = "drill"
//   rotation_length_mm = 30
//   [[ball]]                  # one
//   center_mm = [0, 0, 0]
//   radius_mm = 3
//   carves = true
//   [[line]]                  # `count` balls, the first at `from_mm`, the last at `to_mm`
//   from_mm = [0, 0, 5]
//   to_mm = [0, 0, 60]
//   count = 24
//   radius_mm = 1.5
//
// Frame: the stylus's axes, mm; the stylus points along -z. Threads: pure functions.
// Errors: Error (kInvalidArgument), with the line of the file. Ranges are the daemon's to check.
#pragma once

#include <toml++/toml.h>

#include <span>
#include <string>
#include <string_view>

#include "common/contract/render.h"

namespace palpate {

// The most balls of a line: more than a tool can have.
inline constexpr int kMostBallsOfALine = 1000;

// `name`: of the file, for messages.
HeldTool ParseTool(std::string_view text, std::string_view name);

// A tool that comes with Palpate.
struct OurTool {
  std::string_view name;
  std::string_view text;  // of its file
};
std::span<const OurTool> OurTools();

// One of ours by its name, or a file: its name has a / or ends with .toml. Also throws kNotFound.
HeldTool ReadTool(const std::string& name);

HeldTool ToolFromToml(const toml::table& table);
toml::table ToolToToml(const HeldTool& tool);

}  // namespace palpate
