#include "server/app/config.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <map>
#include <set>
#include <sstream>
#include <string_view>

#include "common/error/error.h"
#include "common/error/one_line.h"
#include "server/app/config_entry.h"
#include "server/app/log.h"
#include "server/app/security_config.h"
#include "server/state/state_file.h"

namespace palpate {
namespace {

using Entry = ConfigEntry;

[[noreturn]] void Fail(const std::string& what) { Entry::Fail(what); }

using Paths = std::vector<std::filesystem::path>;

// The folder must exist.
std::filesystem::path ParseFolder(const Entry& entry) {
  const std::filesystem::path folder = entry.Text();
  PathPolicy({.load_folders = {folder}});  // throws if the folder is missing
  return folder;
}

// As ParseFolder, for a list.
Paths ParseFolders(const Entry& entry) {
  const toml::array* array = entry.node.as_array();
  if (!array) Fail("must be a list of paths, [\"/data\"]");
  Paths folders;
  for (const toml::node& element : *array) {
    const auto text = element.value_exact<std::string>();
    if (!text) Fail("must be a list of paths, [\"/data\"]");
    folders.emplace_back(*text);
  }
  PathPolicy({.load_folders = folders});  // throws if a folder is missing
  return folders;
}

std::uint64_t Mebibytes(const Entry& entry) {
  return static_cast<std::uint64_t>(entry.Integer(1, 1 << 30)) << 20;
}

using Setter = std::function<void(const Entry&, Config&)>;
using SettersByKey = std::map<std::string, Setter, std::less<>>;

FreeSide ParseFreeSide(const Entry& entry) {
  if (const auto side = FreeSideNamed(entry.Text())) return *side;
  Fail("must be \"below\" or \"above\"");
}

SettersByKey HapticsSetters() {
  SettersByKey setters = {
      {"haptics.free_side",
       [](const Entry& e, Config& c) { c.haptics.free_side = ParseFreeSide(e); }},
      {"haptics.method", [](const Entry& e, Config& c) { c.method = ParseMethod(e.Text()); }},
  };
  for (const NumberSetting& setting : kNumberSettings) {
    setters["haptics." + std::string(setting.key)] = [&setting](const Entry& e, Config& c) {
      const double value = e.Number();
      // The condition is false for NaN.
      if (!(value >= setting.low && value <= setting.high)) {
        Fail(fmt::format("must be from {} to {}{}", setting.low, setting.high, setting.unit));
      }
      c.haptics.*setting.member = value;
    };
  }
  for (const FlagSetting& setting : kFlagSettings) {
    setters["haptics." + std::string(setting.key)] = [&setting](const Entry& e, Config& c) {
      c.haptics.*setting.member = e.Flag();
    };
  }
  return setters;
}

bool ParseFrames(const Entry& entry) {
  const std::string frames = entry.Text();
  if (frames != "none" && frames != "framed-firewire") {
    Fail("must be \"none\" or \"framed-firewire\"");
  }
  return frames == "framed-firewire";
}

std::array<double, 3> ParseMotors(const Entry& entry) {
  const Vec3 counts = entry.Triple();
  return {counts.x(), counts.y(), counts.z()};
}

std::vector<std::uint8_t> ParseBytes(const Entry& entry) {
  const toml::array* array = entry.node.as_array();
  std::vector<std::uint8_t> bytes;
  for (std::size_t n = 0; array && n < array->size(); ++n) {
    const auto value = (*array)[n].value_exact<std::int64_t>();
    if (!value || *value < 0 || *value > 255) array = nullptr;
    if (array) bytes.push_back(static_cast<std::uint8_t>(*value));
  }
  if (!array) Fail("must be a list of bytes, [0x01, 0xff]");
  return bytes;
}

std::uint8_t Byte(const Entry& entry) { return static_cast<std::uint8_t>(entry.Integer(0, 255)); }

SettersByKey DeviceSetters() {
  return {
      {"device.kind", [](const Entry& e, Config& c) { c.device.kind = e.Text(); }},
      {"device.pressed_buttons",
       [](const Entry& e, Config& c) { c.device.pressed_buttons = e.Integer(0, 3); }},
      {"device.stop_buttons",
       [](const Entry& e, Config& c) {
         c.device.stop_buttons = static_cast<std::uint32_t>(e.Integer(0, 15));
       }},
      {"device.replay_file", [](const Entry& e, Config& c) { c.device.replay_file = e.Text(); }},
      {"device.usb_port", [](const Entry& e, Config& c) { c.device.usb_port = e.Text(); }},
      {"device.frames",
       [](const Entry& e, Config& c) { c.device.framed_firewire = ParseFrames(e); }},
      {"device.state_command", [](const Entry& e, Config& c) { c.device.state_command = Byte(e); }},
      {"device.force_command", [](const Entry& e, Config& c) { c.device.force_command = Byte(e); }},
      {"device.init_payload",
       [](const Entry& e, Config& c) { c.device.init_payload = ParseBytes(e); }},
      {"device.motor_counts_per_n_mm",
       [](const Entry& e, Config& c) { c.device.motor_counts_per_n_mm = ParseMotors(e); }},
      {"device.falcon_firmware",
       [](const Entry& e, Config& c) { c.device.falcon_firmware = e.Text(); }},
      {"device.openhaptics_library",
       [](const Entry& e, Config& c) { c.device.openhaptics_library = e.Text(); }},
      {"device.openhaptics_name",
       [](const Entry& e, Config& c) { c.device.openhaptics_name = e.Text(); }},
  };
}

std::string ParseLogLevel(const Entry& entry) {
  CheckLogLevel(entry.Text());
  return entry.Text();
}

SettersByKey AllSetters() {
  SettersByKey setters = {
      {"volume.source", [](const Entry& e, Config& c) { c.volume = e.Text(); }},
      {"volume.isovalue", [](const Entry& e, Config& c) { c.isovalue = e.Number(); }},
      {"volume.normalized_isovalue",
       [](const Entry& e, Config& c) { c.normalized_isovalue = e.Number(); }},
      {"volume.spacing_mm", [](const Entry& e, Config& c) { c.spacing_mm = e.Triple(); }},
      {"volume.device_mm_per_volume_mm",
       [](const Entry& e, Config& c) { c.device_mm_per_volume_mm = e.Number(); }},
      {"volume.grid", [](const Entry& e, Config& c) { c.grid = e.Text(); }},
      {"volume.component", [](const Entry& e, Config& c) { c.component = e.Text(); }},
      {"volume.load_folders", [](const Entry& e, Config& c) { c.load_folders = ParseFolders(e); }},
      {"volume.save_folders", [](const Entry& e, Config& c) { c.save_folders = ParseFolders(e); }},
      {"volume.upload_folder",
       [](const Entry& e, Config& c) { c.uploads.folder = ParseFolder(e); }},
      {"volume.max_upload_mib",
       [](const Entry& e, Config& c) { c.uploads.max_bytes = Mebibytes(e); }},
      {"volume.upload_vdb", [](const Entry& e, Config& c) { c.uploads.vdb = e.Flag(); }},
      {"volume.memory_budget_mib",
       [](const Entry& e, Config& c) { c.memory_budget_bytes = Mebibytes(e); }},
      {"server.socket", [](const Entry& e, Config& c) { c.socket_path = e.Text(); }},
      {"server.listen", [](const Entry& e, Config& c) { c.listen = ParseHostPort(e.Text()); }},
      {"metrics.listen",
       [](const Entry& e, Config& c) { c.metrics_listen = ParseHostPort(e.Text()); }},
      {"state.folder", [](const Entry& e, Config& c) { c.state_folder = e.Text(); }},
      {"log.level", [](const Entry& e, Config& c) { c.log_level = ParseLogLevel(e); }},
      {"realtime.priority",
       [](const Entry& e, Config& c) { c.realtime.priority = e.Integer(1, 99); }},
      {"realtime.cpu", [](const Entry& e, Config& c) { c.realtime.cpu = e.Integer(-1, 1023); }},
      {"realtime.lock_memory",
       [](const Entry& e, Config& c) { c.realtime.lock_memory = e.Flag(); }},
  };
  setters.merge(HapticsSetters());
  setters.merge(DeviceSetters());
  for (const auto& [key, set] : SecuritySetters()) {
    setters[key] = [set = set](const Entry& e, Config& c) { set(e, c.security); };
  }
  return setters;
}

const SettersByKey& Setters() {
  static const SettersByKey setters = AllSetters();
  return setters;
}

// 1 and 1.0 give the same text.
std::string Value(const toml::node& node) {
  if (node.is_number()) return fmt::format("{}", ToDouble(node));
  std::ostringstream text;
  node.visit([&](const auto& value) { text << value; });
  return text.str();
}

// The tables of all keys: "haptics" for "haptics.method". Every table has keys.
std::set<std::string> Tables() {
  std::set<std::string> tables;
  for (const auto& [key, set] : Setters()) tables.insert(key.substr(0, key.find('.')));
  return tables;
}

ConfigFault UnknownTable(const std::string& name, std::size_t line) {
  return {name, line,
          fmt::format("is no table of palpated: there are {}", fmt::join(Tables(), ", "))};
}

void Apply(const toml::table& table, const std::string& prefix, Config& config,
           ConfigReading& reading) {
  for (const auto& [name, node] : table) {
    const std::string key = prefix + std::string(name.str());
    const std::size_t line = node.source().begin.line;
    if (const toml::table* section = node.as_table()) {
      if (!Tables().contains(key)) {
        reading.faults.push_back(UnknownTable(key, line));
        continue;
      }
      Apply(*section, key + ".", config, reading);
      continue;
    }
    const auto setter = Setters().find(key);
    try {
      if (setter == Setters().end()) Fail("is no setting of palpated");
      setter->second(Entry{node}, config);
      reading.keys[key] = {line, Value(node)};
    } catch (const Error& error) {
      reading.faults.push_back({key, line, error.what()});
    }
  }
}

// True if `what` continues a sentence that begins with the key.
bool GoesOn(std::string_view what) {
  return what.starts_with("must ") || what.starts_with("is ") || what.starts_with("has ") ||
         what.starts_with("needs ");
}

}  // namespace

DecompositionMethod ParseMethod(const std::string& name) {
  if (const auto method = MethodNamed(name)) return *method;
  throw Error(ErrorKind::kInvalidArgument,
              "unknown method " + name + ": give tpbcc, bcc, tptd or tpbcc-published");
}

ConfigReading ReadConfig(const std::filesystem::path& path, Config& config) {
  ConfigReading reading;
  try {
    Apply(toml::parse_file(path.string()), "", config, reading);
    AppendSecurityFaults(config.security, reading);
  } catch (const toml::parse_error& error) {
    const std::size_t line = error.source().begin.line;
    const std::string what = OneLine(error.description());
    // Line 0: the file cannot be opened.
    reading.faults.push_back({"", line, line > 0 ? what : path.string() + ": " + what});
  }
  // The parser sorts tables by name; people read a file by lines.
  std::stable_sort(reading.faults.begin(), reading.faults.end(),
                   [](const auto& a, const auto& b) { return a.line < b.line; });
  return reading;
}

std::string ToText(const std::filesystem::path& path, const ConfigFault& fault) {
  std::string text;
  if (fault.line > 0) text = fmt::format("{}:{}: ", path.string(), fault.line);
  if (fault.key.empty()) return text + fault.what;
  return text + fault.key + (GoesOn(fault.what) ? " " : ": ") + fault.what;
}

Error AtKey(const LoadedConfig& loaded, std::string_view key, const Error& error) {
  const auto at = loaded.keys.find(key);
  if (at == loaded.keys.end()) return error;
  const ConfigFault fault{at->first, at->second.line, error.what()};
  return {error.kind(), ToText(loaded.file, fault)};
}

}  // namespace palpate
