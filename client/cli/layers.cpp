#include "client/cli/layers.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <sstream>
#include <type_traits>

#include "common/error/error.h"
#include "common/error/number_text.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

constexpr double kSoftNPerMm = 0.3, kFirmNPerMm = 1.0, kSoftPopN = 1.0;

void TakeField(const Json& json, std::string& value) { value = json.get<std::string>(); }
void TakeField(const Json& json, std::uint32_t& value) { value = json.get<std::uint32_t>(); }
void TakeField(const Json& json, double& value) { value = json.get<double>(); }
void TakeField(const Json& json, std::optional<double>& value) {
  if (!json.is_null()) value = json.get<double>();
}

SurfaceLayer LayerOfJson(const Json& json) {
  SurfaceLayer layer{.stiffness_n_per_mm = client::Settings{}.stiffness_n_per_mm};
  std::size_t taken = 0;
  VisitFields(layer, [&](const char* name, auto& value) {
    const auto field = json.find(name);
    if (field == json.end()) return;
    TakeField(*field, value);
    ++taken;
  });
  if (taken != json.size()) Refuse("a layer has a field that this palpate does not know");
  if (!json.contains("name") || !json.contains("isovalue")) {
    Refuse("each layer needs a name and an isovalue");
  }
  return layer;
}

std::string PopsAt(const SurfaceLayer& layer) {
  const double out_n = layer.pop_out_force_n.value_or(layer.pop_force_n);
  if (!(layer.pop_force_n > 0.0)) return "holds";
  return fmt::format("pops at {:g} N{}", layer.pop_force_n,
                     out_n == layer.pop_force_n ? ""
                     : out_n > 0.0              ? fmt::format(", outwards {:g} N", out_n)
                                                : ", never outwards");
}

}  // namespace

SurfaceLayer NewLayer(const std::string& name, bool holds) {
  SurfaceLayer layer{.name = name};
  layer.stiffness_n_per_mm = holds ? kFirmNPerMm : kSoftNPerMm;
  layer.pop_force_n = holds ? 0.0 : kSoftPopN;
  return layer;
}

SurfaceLayers LayersOfList(const std::string& list,
                           const std::function<double(const std::string&)>& isovalue_of) {
  SurfaceLayers layers;
  std::istringstream parts(list == "skin-bone" ? std::string(kSkinBone) : list);
  for (std::string part; std::getline(parts, part, ',');) {
    const std::size_t equals = part.find('=');
    if (equals == 0 || equals == std::string::npos) {
      Refuse("'" + part + "' is no layer: give NAME=ISOVALUE,NAME=ISOVALUE or skin-bone");
    }
    SurfaceLayer layer = NewLayer(part.substr(0, equals), false);
    layer.isovalue = isovalue_of(part.substr(equals + 1));
    layers.layer.push_back(layer);
  }
  if (layers.layer.empty()) Refuse("give NAME=ISOVALUE,NAME=ISOVALUE or skin-bone");
  SurfaceLayer& last = *std::ranges::max_element(layers.layer, {}, &SurfaceLayer::isovalue);
  last.stiffness_n_per_mm = kFirmNPerMm;
  last.pop_force_n = 0.0;
  return layers;
}

std::string Describe(const SurfaceLayer& layer) {
  std::string text =
      fmt::format("{} {}: isovalue {}, {:g} N/mm, {}", layer.id, OneLine(layer.name),
                  NumberText(layer.isovalue), layer.stiffness_n_per_mm, PopsAt(layer));
  const auto add = [&](std::string_view what, double value, std::string_view unit) {
    if (value > 0.0) text += fmt::format(", {} {:g}{}", what, value, unit);
  };
  add("damping", layer.damping_n_s_per_m, " N·s/m");
  add("static friction", layer.static_friction, "");
  add("sliding friction", layer.dynamic_friction, "");
  add("viscosity behind it", layer.viscosity_n_s_per_m, " N·s/m");
  return text;
}

std::string Describe(const SurfaceLayers& layers) {
  if (layers.layer.empty()) return "no layers: the one surface of 'palpate settings' is felt\n";
  std::string text;
  for (const SurfaceLayer& layer : layers.layer) text += Describe(layer) + "\n";
  return text;
}

SurfaceLayers LayersOfJson(const std::string& text) try {
  const Json json = Json::parse(text);
  SurfaceLayers layers;
  for (const Json& layer : json.at("layer")) {
    layers.layer.push_back(LayerOfJson(layer));
    layers.layer.back().id = 0;  // another layer may have it now
  }
  return layers;
} catch (const Json::exception& error) {
  Refuse("these are no layers as `palpate layers --json` prints them: " + OneLine(error.what()));
}

}  // namespace palpate::cli
