#include "server/kept/layer_toml.h"

#include <optional>
#include <string>
#include <type_traits>

#include "common/error/error.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/settings.h"
#include "server/kept/state_file.h"

namespace palpate {
namespace {

// Sets the field with this name. Returns false if there is none, or if the value is of another
// kind.
bool SetField(std::string_view name, const toml::node& node, SurfaceLayer& layer) {
  bool is_set = false;
  VisitFields(layer, [&](std::string_view field, auto& value) {
    using Value = std::remove_cvref_t<decltype(value)>;
    if (field != name) return;
    if constexpr (std::is_same_v<Value, std::string>) {
      const auto text = node.value_exact<std::string>();
      is_set = text.has_value();
      if (is_set) value = *text;
    } else if constexpr (std::is_same_v<Value, std::uint32_t>) {
      const auto number = node.value_exact<std::int64_t>();
      is_set = number && *number >= 1 && *number <= kMaxLayers;
      if (is_set) value = static_cast<Value>(*number);
    } else {
      is_set = node.is_number();
      if (is_set) value = ToDouble(node);
    }
  });
  return is_set;
}

SurfaceLayer LayerOf(const toml::node& node) {
  const toml::table* table = node.as_table();
  if (!table) Refuse("must be [[haptics.layer]] with a name and an isovalue");
  SurfaceLayer layer{.stiffness_n_per_mm = HapticSettings{}.stiffness_n_per_mm};
  for (const auto& [name, value] : *table) {
    if (!SetField(name.str(), value, layer)) {
      Refuse("has no " + std::string(name.str()) + ", or not with this value");
    }
  }
  if (layer.name.empty() || !table->contains("isovalue")) Refuse("needs name and isovalue");
  return layer;
}

}  // namespace

toml::array LayersToToml(const SurfaceLayers& layers) {
  toml::array array;
  for (const SurfaceLayer& layer : layers.layer) {
    toml::table table;
    VisitFields(layer, [&](std::string_view name, const auto& value) {
      using Value = std::remove_cvref_t<decltype(value)>;
      if constexpr (std::is_same_v<Value, std::optional<double>>) {
        if (value) table.insert(name, *value);
      } else if constexpr (std::is_same_v<Value, std::uint32_t>) {
        if (value != 0) table.insert(name, std::int64_t{value});
      } else {
        table.insert(name, value);
      }
    });
    array.push_back(std::move(table));
  }
  return array;
}

SurfaceLayers LayersFromToml(const toml::node& node) {
  const toml::array* array = node.as_array();
  if (!array) Refuse("must be [[haptics.layer]] with a name and an isovalue");
  SurfaceLayers layers;
  for (const toml::node& element : *array) layers.layer.push_back(LayerOf(element));
  return layers;
}

}  // namespace palpate
