#include "server/session/held_tool.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/error/error.h"
#include "common/error/utf8.h"
#include "server/felt/felt_tip.h"
#include "server/haptics/tool/rigid_tool.h"
#include "server/session/range.h"

namespace palpate {
namespace {

constexpr std::size_t kMostToolNameBytes = 31;
constexpr double kFarthestBallMm = 500.0;
constexpr double kGreatestRadiusMm = 20.0;  // as tool_radius_mm
constexpr double kLeastRotationMm = 1.0;
constexpr double kGreatestRotationMm = 300.0;
// Farther, a ball feels softer than a 400th of the stiffness, and a tool was seen to stick.
constexpr double kFarthestInRotations = 20.0;

void CheckBall(std::size_t number, const HeldToolBall& ball) {
  const auto name = [&](std::string_view field) {
    return fmt::format("ball {} of the tool: {}", number, field);
  };
  for (const double coordinate : ball.center_mm) {
    CheckRange(name("center_mm"), coordinate, -kFarthestBallMm, kFarthestBallMm, " mm");
  }
  CheckRange(name("radius_mm"), ball.radius_mm, 0.0, kGreatestRadiusMm, " mm");
  if (ball.carves && ball.radius_mm == 0.0) Refuse(name("one that carves needs a radius_mm"));
}

}  // namespace

void CheckTool(const HeldTool& tool) {
  if (tool.name.size() > kMostToolNameBytes || Utf8(tool.name) != tool.name ||
      std::ranges::any_of(tool.name, [](unsigned char c) { return c < 0x20 || c == 0x7f; })) {
    Refuse(fmt::format("the name of a tool has at most {} bytes, without control characters",
                       kMostToolNameBytes));
  }
  if (tool.ball.size() > kMostToolBalls) {
    Refuse(fmt::format("a tool can have {} balls, not {}", kMostToolBalls, tool.ball.size()));
  }
  for (std::size_t n = 0; n < tool.ball.size(); ++n) CheckBall(n, tool.ball[n]);
  const std::size_t radii = RadiiOf(tool).size();
  if (radii > kMostToolRadii) {
    Refuse(fmt::format("the balls of a tool can have {} different radii, not {}", kMostToolRadii,
                       radii));
  }
  if (tool.rotation_length_mm == 0.0) return;
  CheckRange("rotation_length_mm of the tool", tool.rotation_length_mm, kLeastRotationMm,
             kGreatestRotationMm, " mm");
  double farthest_mm = 0.0;
  for (const HeldToolBall& ball : tool.ball) {
    farthest_mm = std::max(farthest_mm, ball.center_mm.norm());
  }
  if (farthest_mm > kFarthestInRotations * tool.rotation_length_mm) {
    Refuse(
        fmt::format("rotation_length_mm of the tool is {:g}: with a ball {:g} mm from the tip it "
                    "is at least {:g}",
                    tool.rotation_length_mm, farthest_mm, farthest_mm / kFarthestInRotations));
  }
}

std::string RefusalWithTool(const HapticSettings& haptics) {
  if (haptics.tool.ball.empty()) return {};
  if (!haptics.layers.layer.empty()) {
    return "a tool is not felt on layers: remove them (palpate layer --remove all), or put the "
           "tool down (palpate tool none)";
  }
  using S = HapticSettings;
  std::string set = haptics.force_shading ? "force_shading" : "";
  for (const NumberSetting& setting : kNumberSettings) {
    for (const auto forbidden : {&S::static_friction, &S::dynamic_friction, &S::texture_force_n,
                                 &S::pop_force_n, &S::magnet_force_n}) {
      if (setting.member != forbidden || !(haptics.*forbidden > 0.0)) continue;
      set += fmt::format("{}{}", set.empty() ? "" : ", ", setting.key);
    }
  }
  if (set.empty()) return {};
  return fmt::format(
      "a tool is felt without {}: set it to 0 or off, or put the tool down (palpate tool none)",
      set);
}

void CheckHeld(const HapticSettings& haptics, const DeviceDescription& device) {
  if (haptics.tool.ball.empty()) return;
  if (!device.senses_orientation) {
    throw Error(ErrorKind::kFailedPrecondition,
                fmt::format("a tool needs a device that senses how its stylus is turned: {} does "
                            "not",
                            device.kind));
  }
  const std::string refusal = RefusalWithTool(haptics);
  if (!refusal.empty()) throw Error(ErrorKind::kFailedPrecondition, refusal);
}

}  // namespace palpate
