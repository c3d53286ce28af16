#include "server/felt/felt_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

namespace palpate {
namespace {

constexpr double kRounding = 1e-9;  // of the shape of voxels, after turns of the volume

// With a ball of 8 voxels, half a second's work.
constexpr std::size_t kMostFollowed = 8192;
// The bricks that a brick reaches, itself included.
constexpr std::uint64_t kBricksAround = 27;

int Threads() { return static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 4u)); }

}  // namespace

std::optional<Ball> BallOf(double radius_mm, FreeSide side, const AffineMap& X_DI) {
  if (!(radius_mm > 0.0)) return std::nullopt;
  return Ball{.radius_mm = radius_mm,
              .device_from_index = X_DI.linear,
              .is_least = side == FreeSide::kAbove};
}

bool HaveSameField(const Ball& one, const Ball& other) {
  const auto metric = [](const Ball& ball) -> Mat3 {
    const Mat3 in_radii = ball.device_from_index / ball.radius_mm;
    return in_radii.transpose() * in_radii;
  };
  return one.is_least == other.is_least &&
         (metric(one) - metric(other)).norm() <= kRounding * metric(one).norm();
}

double RadiusMm(const Ball& ball, const AffineMap& X_DI) {
  return ball.radius_mm * (X_DI.linear.col(0).norm() / ball.device_from_index.col(0).norm());
}

FeltBall::FeltBall(const Ball& ball, const VolumeSnapshot& volume,
                   const std::function<void(double share)>& progress)
    : ball_(ball),
      maker_(std::make_shared<const BallField>(ball)),
      field_(maker_->Of(volume, Threads(), progress)) {}

std::optional<std::uint64_t> FeltBall::BytesToFollow(const VolumeSnapshot& volume) const {
  if (volume.loaded_revision() != field_->loaded_revision() ||
      volume.revision() < field_->revision()) {
    return std::nullopt;
  }
  const std::size_t changed = volume.bricks().ChangedSince(field_->revision()).size();
  if (changed > kMostFollowed) return std::nullopt;
  return std::min(kBricksAround * changed * Leaf::Bytes(LeafType::kFloat),
                  MostBytes(ball_, volume));
}

void FeltBall::Follow(const VolumeSnapshot& volume) {
  if (volume.revision() == field_->revision()) return;
  if (volume.loaded_revision() != field_->loaded_revision() ||
      volume.revision() < field_->revision()) {
    field_ = maker_->Of(volume, Threads(), [](double) {});
    return;
  }
  std::vector<Vec3i> changed;
  for (const std::uint64_t number : volume.bricks().ChangedSince(field_->revision())) {
    changed.push_back(volume.bricks().BrickOf(number));
  }
  const std::vector<BrickChange> changes = maker_->ChangesOf(volume, *field_, changed, Threads());
  field_ = std::make_shared<const VolumeSnapshot>(maker_->On(volume.metadata()),
                                                  field_->bricks().With(changes, volume.revision()),
                                                  volume.revision(), volume.loaded_revision());
}

void FeltBall::TakeRevisions(const VolumeSnapshot& volume) {
  field_ = std::make_shared<const VolumeSnapshot>(field_->metadata(),
                                                  field_->bricks().AllChangedAt(volume.revision()),
                                                  volume.revision(), volume.loaded_revision());
}

AffineMap FeltBall::PlaceOf(const AffineMap& X_DI) const {
  return {X_DI.linear, X_DI.Apply(-maker_->margin().cast<double>())};
}

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
