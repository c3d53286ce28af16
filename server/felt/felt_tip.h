// What is felt at the stylus: its tip, a ball, or a rigid tool, with the fields of their radii.
//
// Threads: plain values. Not for real-time code.
#pragma once

#include <memory>
#include <vector>

#include "common/contract/render.h"
#include "server/felt/felt_ball.h"
#include "server/felt/scene.h"

namespace palpate {

struct FeltTip {
  HeldTool tool{};  // without balls: none
  // Of a tool: for each of its radii above 0, in the order of RadiiOf. Else of the ball, if there
  // is one.
  std::vector<FeltBall> fields{};
  std::shared_ptr<ToolCaches> caches{};  // of a tool

  bool has_tool() const { return !tool.ball.empty(); }
  // The ball at the tip; null: none.
  const FeltBall* ball() const { return has_tool() || fields.empty() ? nullptr : &fields.front(); }
};

// The different radii of a tool's balls, in the order in which the balls name them first.
std::vector<double> RadiiOf(const HeldTool& tool);

// The fields that the settings' tip needs on a volume that lies so, in the order of FeltTip.
std::vector<Ball> FieldsOf(const HapticSettings& settings, const AffineMap& X_DI);

// Puts the settings' tip together of fields that were made. False, and `tip` stays, if one of them
// is not among `made`.
bool Assemble(const HapticSettings& settings, const AffineMap& X_DI,
              const std::vector<FeltBall>& made, FeltTip& tip);

// A tip whose fields are there. `caches`: of the tip before; new ones are made only if they lack.
FeltTip MakeTip(const HeldTool& tool, std::vector<FeltBall> fields,
                std::shared_ptr<ToolCaches> caches = {});

}  // namespace palpate
