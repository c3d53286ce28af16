#include "common/felt_tool/tool_size.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/error/text.h"

namespace palpate {
namespace {

constexpr double kRotationMm = 30.0;  // for 0
constexpr double kLeastRotationMm = 1.0, kMostRotationMm = 300.0;
// Ranges hold up to this share, so that turns of the volume do not matter.
constexpr double kRounding = 1e-9;

// With two digits, rounded away from `past`; with more where two leave the range.
std::optional<double> Typed(double number, double low, double high, bool up) {
  for (const double digits : {2.0, 3.0, 4.0, 6.0}) {
    const double unit = std::pow(10.0, std::floor(std::log10(number)) + 1.0 - digits);
    const double typed = unit * (up ? std::ceil(number / unit) : std::floor(number / unit));
    if (typed >= low && typed <= high) return std::stod(fmt::format("{:.6g}", typed));
  }
  return std::nullopt;
}

std::optional<double> NearestToOne(double low, double high) {
  if (low <= 1.0 + kRounding && high >= 1.0 - kRounding) return 1.0;
  if (low > high) return std::nullopt;
  return low > 1.0 ? Typed(low, low, high, true) : Typed(high, low, high, false);
}

struct Size {
  // Of balls; of points none. Infinity and 0: all are points.
  double least_radius_mm = std::numeric_limits<double>::infinity(), most_radius_mm = 0.0;
  double length_mm = 0.0;  // from the tip
};

Size SizeOf(const HeldTool& tool) {
  Size size;
  for (const HeldToolBall& ball : tool.ball) {
    size.length_mm = std::max(size.length_mm, ball.center_mm.norm() + ball.radius_mm);
    if (ball.radius_mm <= 0.0) continue;
    size.least_radius_mm = std::min(size.least_radius_mm, ball.radius_mm);
    size.most_radius_mm = std::max(size.most_radius_mm, ball.radius_mm);
  }
  return size;
}

}  // namespace

HeldTool Scaled(HeldTool tool, double scale) {
  for (HeldToolBall& ball : tool.ball) {
    ball.center_mm *= scale;
    ball.radius_mm *= scale;
  }
  const double rotation_mm = tool.rotation_length_mm > 0.0 ? tool.rotation_length_mm : kRotationMm;
  tool.rotation_length_mm = std::clamp(scale * rotation_mm, kLeastRotationMm, kMostRotationMm);
  return tool;
}

std::optional<double> FittingScale(const HeldTool& tool, double voxel_mm) {
  const Size size = SizeOf(tool);
  if (size.most_radius_mm == 0.0) return 1.0;
  return NearestToOne(kLeastBallVoxels * voxel_mm / size.least_radius_mm,
                      kMostBallVoxels * voxel_mm / size.most_radius_mm);
}

std::optional<double> FittingMagnification(const HeldTool& tool, double voxel_mm) {
  const Size size = SizeOf(tool);
  if (size.most_radius_mm == 0.0) return 1.0;
  return NearestToOne(size.most_radius_mm / (kMostBallVoxels * voxel_mm),
                      size.least_radius_mm / (kLeastBallVoxels * voxel_mm));
}

std::string InWords(const HeldTool& tool) {
  if (tool.ball.empty()) return "no tool: the stylus's tip is felt";
  const Size size = SizeOf(tool);
  const auto carving = std::ranges::count_if(tool.ball, &HeldToolBall::carves);
  const auto points = std::ranges::count(tool.ball, 0.0, &HeldToolBall::radius_mm);
  const double least_mm = points > 0 ? 0.0 : size.least_radius_mm;
  const std::string radii = least_mm == size.most_radius_mm
                                ? fmt::format("{:.3g} mm", least_mm)
                                : fmt::format("{:.3g} to {:.3g} mm", least_mm, size.most_radius_mm);
  return fmt::format(
      "{}: {} balls of radius {}, up to {:.3g} mm from the tip{}",
      tool.name.empty() ? "a tool without a name" : OneLine(tool.name), tool.ball.size(), radii,
      size.length_mm,
      carving > 0 ? fmt::format("; {} carve{}", carving, carving == 1 ? "s" : "") : "");
}

std::string SizeInVolume(const HeldTool& tool, double device_mm_per_mm) {
  const Size size = SizeOf(tool);
  return fmt::format("{:.3g} mm thick and {:.3g} mm long in the volume",
                     2.0 * size.most_radius_mm / device_mm_per_mm,
                     size.length_mm / device_mm_per_mm);
}

}  // namespace palpate
