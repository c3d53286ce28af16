#include "server/scene/felt_surface.h"

#include <cmath>
#include <limits>
#include <memory>

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

}  // namespace

void FeelSurface(const AffineMap& X_DI, double density, std::uint64_t geometry_revision,
                 const std::optional<FeltBall>& ball, Scene& scene) {
  const HapticSettings& settings = scene.settings;
  scene.ball.reset();
  if (ball) scene.ball = SceneBall{ball->field(), ball->ball(), ball->RadiusMm(X_DI), X_DI};
  scene.surface = MakeHapticSurface(*scene.felt_volume(), ball ? ball->PlaceOf(X_DI) : X_DI,
                                    density, settings.method, geometry_revision,
                                    ball ? ball->side() : settings.free_side,
                                    static_cast<int>(settings.refinement));
  FeelLayers(scene);
}

}  // namespace palpate
