#include "server/felt/felt_tip.h"

#include <algorithm>
#include <utility>

namespace palpate {

std::vector<double> RadiiOf(const HeldTool& tool) {
  std::vector<double> radii;
  for (const HeldToolBall& ball : tool.ball) {
    if (std::ranges::find(radii, ball.radius_mm) == radii.end()) radii.push_back(ball.radius_mm);
  }
  return radii;
}

std::vector<Ball> FieldsOf(const HapticSettings& settings, const AffineMap& X_DI) {
  std::vector<Ball> fields;
  if (settings.tool.ball.empty()) {
    if (const auto ball = BallOf(settings.tool_radius_mm, settings.free_side, X_DI)) {
      fields.push_back(*ball);
    }
    return fields;
  }
  for (const double radius_mm : RadiiOf(settings.tool)) {
    if (const auto ball = BallOf(radius_mm, settings.free_side, X_DI)) fields.push_back(*ball);
  }
  return fields;
}

bool Assemble(const HapticSettings& settings, const AffineMap& X_DI,
              const std::vector<FeltBall>& made, FeltTip& tip) {
  std::vector<FeltBall> fields;
  for (const Ball& wanted : FieldsOf(settings, X_DI)) {
    const auto field = std::ranges::find_if(
        made, [&](const FeltBall& one) { return HaveSameField(one.ball(), wanted); });
    if (field == made.end()) return false;
    fields.push_back(*field);
  }
  tip = MakeTip(settings.tool, std::move(fields), tip.caches);
  return true;
}

FeltTip MakeTip(const HeldTool& tool, std::vector<FeltBall> fields,
                std::shared_ptr<ToolCaches> caches) {
  FeltTip tip{.tool = tool, .fields = std::move(fields), .caches = {}};
  if (!tip.has_tool()) return tip;
  tip.caches = caches ? std::move(caches) : std::make_shared<ToolCaches>();
  for (std::size_t n = 0; n < RadiiOf(tool).size(); ++n) {
    auto& cache = (*tip.caches)[n];
    if (!cache) cache = std::make_unique<ToolCellCache>();
  }
  return tip;
}

}  // namespace palpate
