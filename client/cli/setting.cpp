#include "client/cli/setting.h"

#include <fmt/core.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <variant>

#include "common/error/error.h"
#include "common/error/text.h"

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

namespace {

using client::ChoiceSetting;
using client::FlagSetting;
using client::NumberSetting;

std::optional<double> ParseNumber(const std::string& text) {
  double value = 0.0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || rest != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<bool> ParseFlag(const std::string& text) {
  if (text == "on" || text == "true") return true;
  if (text == "off" || text == "false") return false;
  return std::nullopt;
}

// Parses a text into an update. Returns false if the text is not a valid value.
struct Store {
  const std::string& text;
  client::SettingsUpdate& update;

  bool operator()(const NumberSetting& number) const {
    const std::optional<double> value = ParseNumber(text);
    if (value) update.*number.update = value;
    return value.has_value();
  }
  bool operator()(const FlagSetting& flag) const {
    const std::optional<bool> value = ParseFlag(text);
    if (value) update.*flag.update = value;
    return value.has_value();
  }
  bool operator()(const ChoiceSetting& choice) const {
    const auto word = std::find(choice.words.begin(), choice.words.end(), text);
    if (word == choice.words.end()) return false;
    choice.update(update, static_cast<std::size_t>(word - choice.words.begin()));
    return true;
  }
};

struct KindToJson {
  const client::Settings& settings;

  nlohmann::ordered_json operator()(const NumberSetting& number) const {
    return settings.*number.member;
  }
  nlohmann::ordered_json operator()(const FlagSetting& flag) const { return settings.*flag.member; }
  nlohmann::ordered_json operator()(const ChoiceSetting& choice) const {
    return choice.words[choice.get(settings)];
  }
};

std::string WithUnit(const std::string& text, const Setting& setting) {
  return setting.unit.empty() ? text : fmt::format("{} {}", text, setting.unit);
}

}  // namespace

const Setting* FindSetting(std::string_view name) {
  const auto found =
      std::find_if(client::kSettings.begin(), client::kSettings.end(),
                   [name](const Setting& s) { return s.name == name || s.key == name; });
  return found == client::kSettings.end() ? nullptr : &*found;
}

std::vector<std::string_view> WordsOf(const Setting& setting) {
  if (std::holds_alternative<FlagSetting>(setting.kind)) return {"on", "off"};
  const auto* choice = std::get_if<ChoiceSetting>(&setting.kind);
  if (!choice) return {};
  return {choice->words.begin(), choice->words.end()};
}

std::string ValuesOf(const Setting& setting) {
  if (const auto* number = std::get_if<NumberSetting>(&setting.kind)) {
    if (!std::isfinite(number->maximum)) return "a number";
    const char* const whole = number->whole ? ", whole" : "";
    return WithUnit(fmt::format("{:g} to {:g}{}", number->minimum, number->maximum, whole),
                    setting);
  }
  const std::vector<std::string_view> words = WordsOf(setting);
  std::string text;
  for (std::size_t n = 0; n < words.size(); ++n) {
    if (n > 0) text += n + 1 < words.size() ? ", " : " or ";
    text += words[n];
  }
  return text;
}

std::string ListOfSettings() {
  std::string text;
  for (const Setting& setting : client::kSettings) {
    text += fmt::format("  {:<20}{}; {}\n", setting.name, ValuesOf(setting), setting.help);
  }
  return text;
}

bool StoreSetting(const Setting& setting, const std::string& text, client::SettingsUpdate& update) {
  return std::visit(Store{text, update}, setting.kind);
}

nlohmann::ordered_json SettingJson(const Setting& setting, const client::Settings& settings) {
  if (!client::IsKnown(settings, setting)) return nullptr;
  return std::visit(KindToJson{settings}, setting.kind);
}

std::string DescribeSetting(const Setting& setting, const client::Settings& settings) {
  const nlohmann::ordered_json value = SettingJson(setting, settings);
  std::string text = "unknown";
  if (value.is_number()) text = WithUnit(NumberText(value.get<double>()), setting);
  if (value.is_boolean()) text = value.get<bool>() ? "on" : "off";
  if (value.is_string()) text = value.get<std::string>();
  return fmt::format("{} {}", setting.name, text);
}

bool IsOff(const Setting& setting, const client::Settings& settings) {
  const nlohmann::ordered_json value = SettingJson(setting, settings);
  return value == 0.0 || value == false;
}

}  // namespace palpate::cli
