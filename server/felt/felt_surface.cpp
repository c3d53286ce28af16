#include "server/felt/felt_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

namespace palpate {

double DensityOf(const VolumeSnapshot& volume, double isovalue) {
  double density = volume.Normalize(isovalue);
  while (volume.Denormalize(density) > isovalue) {
    density = std::nextafter(density, -std::numeric_limits<double>::infinity());
  }
  return density;
}

namespace {

void FeelLayers(Scene& scene) {
  const HapticSettings& settings = scene.settings;
  if (settings.layers.layer.empty()) return;
  const auto felt = std::make_shared<HapticLayers>();
  for (const SurfaceLayer& layer : settings.layers.layer) {
    felt->layer[static_cast<std::size_t>(felt->count++)] = {
        .id = static_cast<int>(layer.id),
        .isovalue = DensityOf(*scene.volume, layer.isovalue),
        .asked_isovalue = layer.isovalue,
        .stiffness_n_per_mm = layer.stiffness_n_per_mm,
        .damping_n_s_per_m = layer.damping_n_s_per_m,
        .static_friction = layer.static_friction,
        .dynamic_friction = layer.dynamic_friction,
        .pop_in_n = layer.pop_force_n,
        .pop_out_n = layer.pop_out_force_n.value_or(layer.pop_force_n),
        .viscosity_n_s_per_m = layer.viscosity_n_s_per_m,
        .texture_force_n = settings.texture_force_n,
        .texture_wavelength_mm = settings.texture_wavelength_mm};
  }
  scene.layers = felt;
  scene.surface.layers = felt.get();
}

// The shape of a tool, without what it is felt on.
RigidTool ShapeOf(const HeldTool& held) {
  RigidTool tool;
  const std::vector<double> radii = RadiiOf(held);
  tool.radius_count = static_cast<int>(radii.size());
  std::ranges::copy(radii, tool.radius_mm.begin());
  if (held.rotation_length_mm > 0.0) tool.rotation_length_mm = held.rotation_length_mm;
  for (const HeldToolBall& ball : held.ball) {
    const auto radius = std::ranges::find(radii, ball.radius_mm) - radii.begin();
    tool.ball[static_cast<std::size_t>(tool.count++)] = {
        .p_SBall_mm = ball.center_mm, .radius = static_cast<std::uint8_t>(radius)};
  }
  return tool;
}

void FeelTool(const AffineMap& X_DI, double density, std::uint64_t geometry_revision,
              const FeltTip& tip, Scene& scene) {
  const HapticSettings& settings = scene.settings;
  const auto tool = std::make_shared<SceneTool>();
  tool->held = tip.tool;
  tool->caches = tip.caches;
  tool->felt.tool = ShapeOf(tip.tool);
  const FreeSide side = tip.fields.empty() ? settings.free_side : tip.fields.front().side();
  auto field = tip.fields.begin();
  for (std::size_t n = 0; n < static_cast<std::size_t>(tool->felt.tool.radius_count); ++n) {
    AffineMap place = X_DI;
    tool->volume[n] = scene.volume;
    if (tool->felt.tool.radius_mm[n] > 0.0) {
      place = field->PlaceOf(X_DI);
      tool->volume[n] = field->field();
      tool->fields.push_back(field++->ball());
    }
    tool->felt.surface[n] =
        MakeHapticSurface(*tool->volume[n], place, density, settings.method, geometry_revision,
                          side, static_cast<int>(settings.refinement));
    tool->felt.cache[n] = (*tip.caches)[n].get();
  }
  scene.tool = tool;
}

}  // namespace

void FeelSurface(const AffineMap& X_DI, double density, std::uint64_t geometry_revision,
                 const FeltTip& tip, Scene& scene) {
  const HapticSettings& settings = scene.settings;
  const FeltBall* const ball = tip.ball();
  scene.ball.reset();
  scene.tool.reset();
  if (ball) scene.ball = SceneBall{ball->field(), ball->ball(), ball->RadiusMm(X_DI), X_DI};
  if (tip.has_tool()) FeelTool(X_DI, density, geometry_revision, tip, scene);
  scene.surface = MakeHapticSurface(*scene.felt_volume(), ball ? ball->PlaceOf(X_DI) : X_DI,
                                    density, settings.method, geometry_revision,
                                    ball ? ball->side() : settings.free_side,
                                    static_cast<int>(settings.refinement));
  FeelLayers(scene);
}

}  // namespace palpate
