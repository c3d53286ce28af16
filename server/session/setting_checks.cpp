#include "server/session/setting_checks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <type_traits>
#include <vector>

#include "common/error/error.h"
#include "common/error/text.h"
#include "server/felt/felt_surface.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/settings.h"
#include "server/haptics/tool/rigid_tool.h"
#include "server/volume/snapshot/volume_metadata.h"

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
    return "a tool is not felt on layers: remove the layers, or put the tool down";
  }
  std::vector<std::string_view> set;
  for (const FlagSetting& setting : kFlagSettings) {
    if (setting.refused_with_tool && haptics.*setting.member) set.push_back(setting.key);
  }
  for (const NumberSetting& setting : kNumberSettings) {
    if (setting.refused_with_tool && haptics.*setting.member > 0.0) set.push_back(setting.key);
  }
  if (set.empty()) return {};
  return fmt::format("a tool is felt without {}: set it to 0 or off, or put the tool down",
                     fmt::join(set, ", "));
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

namespace {

constexpr std::size_t kMostNameBytes = 31;

std::string TitleOf(const SurfaceLayer& layer) { return "layer '" + layer.name + "'"; }

// The range of a layer's number is that of the setting with its name; of pop_out_force_n that of
// pop_force_n.
void CheckNumber(const SurfaceLayer& layer, std::string_view key, double value) {
  const std::string_view like = key == "pop_out_force_n" ? "pop_force_n" : key;
  for (const NumberSetting& setting : kNumberSettings) {
    if (setting.key != like) continue;
    CheckRange(fmt::format("{}: {}", TitleOf(layer), key), value, setting.low, setting.high,
               setting.unit);
  }
}

bool IsName(const std::string& name) {
  return !name.empty() && name.size() <= kMostNameBytes && Utf8(name) == name &&
         std::ranges::none_of(name, [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

void CheckLayer(const SurfaceLayer& layer) {
  if (!IsName(layer.name)) {
    Refuse(fmt::format("a layer needs a name of 1 to {} bytes, without control characters",
                       kMostNameBytes));
  }
  if (layer.id > kMaxLayers) {
    Refuse(fmt::format("{}: its id is {}: give one from 1 to {}, or none", TitleOf(layer), layer.id,
                       kMaxLayers));
  }
  if (!std::isfinite(layer.isovalue)) Refuse(TitleOf(layer) + ": its isovalue is no number");
  VisitFields(layer, [&](std::string_view key, const auto& value) {
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (std::is_same_v<Value, double>) {
      CheckNumber(layer, key, value);
    } else if constexpr (std::is_same_v<Value, std::optional<double>>) {
      if (value) CheckNumber(layer, key, *value);
    }
  });
}

bool Has(const VolumeMetadata& volume, const SurfaceLayer& layer) {
  return layer.isovalue >= volume.value_min && layer.isovalue <= volume.value_max;
}

bool AreApart(const VolumeMetadata& volume, const SurfaceLayer& a, const SurfaceLayer& b) {
  return b.isovalue - a.isovalue >= kLeastLayerGap * (volume.value_max - volume.value_min);
}

bool HasId(const SurfaceLayers& layers, std::uint32_t id) {
  return std::ranges::any_of(layers.layer, [&](const auto& layer) { return layer.id == id; });
}

// A stylus that has passed a layer has not passed another one that gets its id. If all ids are
// felt, the innermost one is the least likely to be passed.
std::uint32_t NewId(const SurfaceLayers& layers, const SurfaceLayers& felt) {
  for (std::uint32_t id = 1; id <= kMaxLayers; ++id) {
    if (!HasId(layers, id) && !HasId(felt, id)) return id;
  }
  std::uint32_t id = 0;
  for (const SurfaceLayer& layer : felt.layer) {
    if (!HasId(layers, layer.id)) id = layer.id;
  }
  return id;
}

// From outside: what the stylus has passed is the first ones.
void GiveIds(const SurfaceLayers& felt, SurfaceLayers& layers) {
  for (const bool has_name : {true, false}) {
    for (SurfaceLayer& layer : layers.layer) {
      if (layer.id != 0) continue;
      const auto same = std::ranges::find(felt.layer, layer.name, &SurfaceLayer::name);
      if (has_name && same != felt.layer.end() && !HasId(layers, same->id)) layer.id = same->id;
      if (!has_name) layer.id = NewId(layers, felt);
    }
  }
}

}  // namespace

void OrderLayers(const SurfaceLayers& felt, SurfaceLayers& layers) {
  if (layers.layer.size() > kMaxLayers) {
    Refuse(fmt::format("there can be {} layers, not {}", kMaxLayers, layers.layer.size()));
  }
  for (const SurfaceLayer& layer : layers.layer) CheckLayer(layer);
  std::ranges::stable_sort(layers.layer, {}, &SurfaceLayer::isovalue);
  GiveIds(felt, layers);
  std::set<std::uint32_t> ids;
  std::set<std::string> names;
  for (const SurfaceLayer& layer : layers.layer) {
    if (!names.insert(layer.name).second) Refuse("there are two of " + TitleOf(layer));
    if (!ids.insert(layer.id).second) Refuse(fmt::format("two layers have the id {}", layer.id));
  }
}

void CheckSide(const SurfaceLayers& layers, FreeSide side) {
  if (layers.layer.empty() || side == FreeSide::kBelow) return;
  Refuse("layers are felt from below: leave free_side below, or remove the layers");
}

void CheckLayers(const SurfaceLayers& layers, const VolumeMetadata& volume) {
  const SurfaceLayer* before = nullptr;
  for (const SurfaceLayer& layer : layers.layer) {
    CheckRange(TitleOf(layer) + ": isovalue", layer.isovalue, volume.value_min, volume.value_max,
               volume.unit.empty() ? "" : " " + volume.unit);
    if (before && !AreApart(volume, *before, layer)) {
      Refuse(fmt::format("{} and {} are too close: their isovalues must be {:g} apart",
                         TitleOf(*before), TitleOf(layer),
                         kLeastLayerGap * (volume.value_max - volume.value_min)));
    }
    before = &layer;
  }
}

std::string RemoveLayersOf(const VolumeMetadata& before, const VolumeMetadata& volume,
                           SurfaceLayers& layers) {
  // As after it was saved and loaded again.
  const bool is_same = before.source == volume.source ||
                       (before.size == volume.size && before.spacing_mm == volume.spacing_mm);
  const bool means_same = before.unit == volume.unit && (!volume.unit.empty() || is_same);
  if (layers.layer.empty() || means_same) return {};
  std::vector<std::string> gone;
  for (const SurfaceLayer& layer : layers.layer) {
    gone.push_back(fmt::format("{}={:.9g}", layer.name, layer.isovalue));
  }
  layers = {};
  return fmt::format("the layers of the volume before are removed: {}; set them again if they "
                     "mean the same here",
                     fmt::join(gone, ","));
}

std::string FitLayers(const VolumeMetadata& volume, FreeSide side, SurfaceLayers& layers) {
  const bool is_above = side == FreeSide::kAbove;
  std::vector<SurfaceLayer> kept;
  std::vector<std::string> left;
  for (const SurfaceLayer& layer : layers.layer) {
    const bool fits =
        !is_above && Has(volume, layer) && (kept.empty() || AreApart(volume, kept.back(), layer));
    if (fits) {
      kept.push_back(layer);
    } else {
      left.push_back(fmt::format("'{}' ({:.9g})", layer.name, layer.isovalue));
    }
  }
  if (left.empty()) return {};
  layers.layer = std::move(kept);
  const std::string why =
      is_above ? std::string("they are felt from below, and this volume from above")
               : fmt::format("the volume has values from {:.9g} to {:.9g}{}", volume.value_min,
                             volume.value_max, volume.unit.empty() ? "" : " " + volume.unit);
  return fmt::format("layers left out: {}; {}", fmt::join(left, ", "), why);
}

}  // namespace palpate
