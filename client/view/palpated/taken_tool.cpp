#include "client/view/palpated/taken_tool.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "client/view/palpated/setting_change.h"
#include "common/felt_tool/tool_size.h"

namespace palpate::view {
namespace {

void PutOff(const client::Settings& now, TakenTool& taken) {
  std::vector<std::string_view> labels;
  for (const client::Setting& setting : client::kSettings) {
    if (!setting.refused_with_tool || ValueOf(setting, now) == 0.0) continue;
    labels.push_back(setting.label);
    SetIn(setting, 0.0, taken.update);
  }
  if (!labels.empty()) taken.needs.push_back(fmt::format("off: {}", fmt::join(labels, ", ")));
}

void MakeFit(const HeldTool& tool, double voxel_mm, TakenTool& taken) {
  const auto scale = FittingScale(tool, voxel_mm);
  taken.is_possible = scale.has_value();
  if (!scale) {
    taken.needs.emplace_back("its balls differ too much in size for this volume's voxels");
    return;
  }
  if (*scale == 1.0) return;
  taken.update.tool = Scaled(tool, *scale);
  taken.magnification = FittingMagnification(tool, voxel_mm);
  taken.needs.push_back(fmt::format("{:g} of its size: a ball here is {:.2g} to {:.2g} mm wide",
                                    *scale, 2.0 * kLeastBallVoxels * voxel_mm,
                                    2.0 * kMostBallVoxels * voxel_mm));
}

}  // namespace

TakenTool TakeTool(const HeldTool& tool, const client::Settings& now, double voxel_mm) {
  TakenTool taken;
  taken.update.tool = tool;
  if (tool.ball.empty()) return taken;
  if (!now.layers.layer.empty()) {
    const SurfaceLayer& stays = now.layers.layer.back();
    taken.needs.push_back(fmt::format("no layers: {} alone is felt", stays.name));
    taken.update.layers = SurfaceLayers();
    taken.update.isovalue = stays.isovalue;
  }
  PutOff(now, taken);
  MakeFit(tool, voxel_mm, taken);
  return taken;
}

}  // namespace palpate::view
