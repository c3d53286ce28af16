#include "server/session/layers.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <type_traits>

#include "common/error/error.h"
#include "common/error/utf8.h"
#include "server/haptics/layers.h"
#include "server/haptics/settings.h"
#include "server/session/range.h"

namespace palpate {
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
  Refuse(
      "layers are felt from below: leave free_side below, or remove the layers "
      "(palpate layer --remove all)");
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
