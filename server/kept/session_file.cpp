#include "server/kept/session_file.h"

#include <utility>

#include "common/error/error.h"
#include "common/felt_tool/tool_file.h"
#include "server/kept/layer_toml.h"
#include "server/kept/state_file.h"

namespace palpate {
namespace {

void Put(toml::table& table, std::string_view key, const std::optional<double>& value) {
  if (value) table.insert(key, *value);
}

// Where a volume is, and how to read it.
toml::table SourceTable(const LoadRequest& request) {
  toml::table table;
  if (HoldsAsToml(request.source)) table.insert("source", request.source);
  if (HoldsAsToml(request.title)) table.insert("title", request.title);
  if (request.spacing_mm) table.insert("spacing_mm", ToTomlArray(*request.spacing_mm));
  if (request.frame) table.insert("frame", *request.frame);
  if (!request.grid.empty() && HoldsAsToml(request.grid)) table.insert("grid", request.grid);
  if (!request.component.empty()) table.insert("component", request.component);
  if (request.raw) {
    table.insert("raw", toml::table{{"size", ToTomlArray(request.raw->size)},
                                    {"type", request.raw->type},
                                    {"big_endian", request.raw->big_endian},
                                    {"offset_bytes", request.raw->offset_bytes}});
  }
  return table;
}

std::optional<RawVoxels> RawOf(const toml::table& table) {
  const auto size = TomlNumbers<3>(table, "size");
  if (!size) return std::nullopt;
  RawVoxels raw;
  for (std::size_t n = 0; n < 3; ++n) {
    const double axis = (*size)[static_cast<Eigen::Index>(n)];
    // No volume has a size outside of this range.
    raw.size[n] = axis >= 1.0 && axis <= 1e15 ? static_cast<std::int64_t>(axis) : 0;
  }
  raw.type = table["type"].value_or(std::string());
  raw.big_endian = table["big_endian"].value_or(false);
  raw.offset_bytes = table["offset_bytes"].value_or(std::int64_t{0});
  return raw;
}

LoadRequest SourceOf(const toml::table& table) {
  LoadRequest request;
  request.source = table["source"].value_or(std::string());
  request.title = table["title"].value_or(std::string());
  if (const auto spacing_mm = TomlNumbers<3>(table, "spacing_mm")) {
    request.spacing_mm = Vec3(*spacing_mm);
  }
  request.frame = table["frame"].value<std::int64_t>();
  request.grid = table["grid"].value_or(std::string());
  request.component = table["component"].value_or(std::string());
  if (const toml::table* raw = table["raw"].as_table()) request.raw = RawOf(*raw);
  return request;
}

toml::table HapticsTable(const RenderSettings& settings) {
  toml::table table;
  for (const NumberSetting& setting : kNumberSettings) {
    table.insert(setting.key, settings.haptics.*setting.member);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    table.insert(setting.key, settings.haptics.*setting.member);
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    table.insert(setting.key, WordOf(setting, setting.get(settings.haptics)));
  }
  const SurfaceLayers& layers = settings.haptics.layers;
  if (!layers.layer.empty()) table.insert("layer", LayersToToml(layers));
  const HeldTool& tool = settings.haptics.tool;
  if (!tool.ball.empty()) table.insert("tool", ToolToToml(tool));
  return table;
}

// Settings that the file does not name get their defaults.
RenderSettings SettingsOf(const toml::table& table) {
  RenderSettings settings;
  HapticSettings& haptics = settings.haptics;
  for (const ChoiceSetting& setting : kChoiceSettings) {
    const auto number = NumberOf(setting, table[setting.key].value_or(std::string_view()));
    if (number) setting.set(haptics, *number);
  }
  for (const NumberSetting& setting : kNumberSettings) {
    haptics.*setting.member = TomlNumber(table, setting.key).value_or(haptics.*setting.member);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    haptics.*setting.member = table[setting.key].value_or(haptics.*setting.member);
  }
  if (const toml::node* layers = table.get("layer")) haptics.layers = LayersFromToml(*layers);
  if (const toml::table* tool = table["tool"].as_table()) haptics.tool = ToolFromToml(*tool);
  return settings;
}

}  // namespace

SessionFile ReadSessionFile(const std::filesystem::path& path) try {
  std::error_code unknown;  // an error is reported below as a file that cannot be read
  const auto status = std::filesystem::symlink_status(path, unknown);
  if (status.type() == std::filesystem::file_type::not_found) return {};
  const StateFile file = ReadStateFile(path);
  if (!file.damage.empty()) return {{}, file.damage};
  const toml::table* configured = file.table["configured"].as_table();
  const toml::table* volume = file.table["volume"].as_table();
  const toml::table* haptics = file.table["haptics"].as_table();
  if (!configured || !volume || !haptics) return {{}, "a part of it is missing"};
  SavedSession session;
  session.configured = SourceOf(*configured);
  session.configured.device_mm_per_volume_mm = TomlNumber(*configured, "device_mm_per_volume_mm");
  session.configured.isovalue = TomlNumber(*configured, "isovalue");
  session.configured.normalized_isovalue = TomlNumber(*configured, "normalized_isovalue");
  if (const toml::table* settings = (*configured)["haptics"].as_table()) {
    session.configured_settings = SettingsOf(*settings);
  }
  session.attempts = file.table["attempts"].value_or(0);
  session.ended_cleanly = file.table["ended_cleanly"].value_or(false);
  session.felt.volume = SourceOf(*volume);
  session.felt.settings = SettingsOf(*haptics);
  const auto isovalue = TomlNumber(*volume, "isovalue");
  if (!isovalue) return {{}, "there is no isovalue in it"};
  session.felt.settings.isovalue = *isovalue;
  return {std::move(session), ""};
} catch (const Error& error) {
  return {{}, std::string("a layer or tool in it: ") + error.what()};
}

void WriteSessionFile(const std::filesystem::path& path, const SavedSession& session) {
  toml::table configured = SourceTable(session.configured);
  Put(configured, "device_mm_per_volume_mm", session.configured.device_mm_per_volume_mm);
  Put(configured, "isovalue", session.configured.isovalue);
  Put(configured, "normalized_isovalue", session.configured.normalized_isovalue);
  configured.insert("haptics", HapticsTable(session.configured_settings));
  toml::table volume = SourceTable(session.felt.volume);
  volume.insert("isovalue", session.felt.settings.isovalue);
  WriteStateFile(path,
                 "# The session of palpated, which the next palpated on this socket restores.\n",
                 toml::table{{"attempts", session.attempts},
                             {"ended_cleanly", session.ended_cleanly},
                             {"configured", std::move(configured)},
                             {"volume", std::move(volume)},
                             {"haptics", HapticsTable(session.felt.settings)}});
}

}  // namespace palpate
