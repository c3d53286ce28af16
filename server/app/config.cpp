#include "server/app/config.h"

#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <functional>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include "common/error/error.h"
#include "common/error/text.h"
#include "server/app/log.h"
#include "server/kept/layer_toml.h"
#include "server/kept/state_file.h"
#include "server/session/setting_checks.h"

namespace palpate {
namespace {

// The keys of the configuration file, and how each is read.
//
// Threads: main. Errors: Error (kInvalidArgument) that says what is wrong with a value. The caller
// adds the file's name, the line and the key.

using ConfigSetter = std::function<void(const toml::node&, Config&)>;

using Paths = std::vector<std::filesystem::path>;

struct Entry {
  const toml::node& node;

  std::string Text() const {
    if (const auto value = node.value_exact<std::string>()) return *value;
    Refuse("must be a text in quotes");
  }
  double Number() const {
    if (node.is_number()) return ToDouble(node);
    Refuse("must be a number");
  }
  double NumberWithin(double low, double high) const {
    const double value = Number();
    if (value >= low && value <= high) return value;
    Refuse(fmt::format("must be a number from {:g} to {:g}", low, high));
  }
  int Integer(int low, int high) const {
    const auto value = node.value_exact<std::int64_t>();
    if (value && *value >= low && *value <= high) return static_cast<int>(*value);
    Refuse(fmt::format("must be a whole number from {} to {}", low, high));
  }
  bool Flag() const {
    if (const auto value = node.value_exact<bool>()) return *value;
    Refuse("must be true or false");
  }
  Vec3 Triple() const {
    const toml::array* array = node.as_array();
    if (!array || array->size() != 3) Refuse("must be three numbers, [x, y, z]");
    Vec3 v;
    for (std::size_t n = 0; n < 3; ++n) {
      if (!(*array)[n].is_number()) Refuse("must be three numbers, [x, y, z]");
      v[static_cast<Eigen::Index>(n)] = ToDouble((*array)[n]);
    }
    return v;
  }
};

Paths Folders(const Entry& entry) {
  const toml::array* array = entry.node.as_array();
  if (!array) Refuse("must be a list of paths, [\"/data\"]");
  Paths folders;
  for (const toml::node& element : *array) {
    const auto text = element.value_exact<std::string>();
    if (!text) Refuse("must be a list of paths, [\"/data\"]");
    folders.emplace_back(*text);
  }
  return folders;
}

std::uint64_t Mebibytes(const Entry& entry) {
  return static_cast<std::uint64_t>(entry.Integer(1, 1 << 30)) << 20;
}

std::string LogLevelName(const Entry& entry) {
  CheckLogLevel(entry.Text());
  return entry.Text();
}

std::string OneOf(const Entry& entry, const std::vector<std::string>& names) {
  const std::string name = entry.Text();
  if (std::find(names.begin(), names.end(), name) != names.end()) return name;
  Refuse(fmt::format("must be one of {}", fmt::join(names, ", ")));
}

RawVoxels& Raw(Config& config) {
  if (!config.volume.raw) config.volume.raw.emplace();
  return *config.volume.raw;
}

std::array<std::int64_t, 3> RawSize(const Entry& entry) {
  const Vec3 size = entry.Triple();
  constexpr double kMost = 1'000'000.0;
  if (!(size.array() >= 2.0 && size.array() <= kMost && size.array() == size.array().floor()).all())
    Refuse("must be three whole numbers from 2 on");
  return {static_cast<std::int64_t>(size.x()), static_cast<std::int64_t>(size.y()),
          static_cast<std::int64_t>(size.z())};
}

Role ParseRole(const Entry& entry) {
  if (const auto role = Named<Role>(entry.Text())) return *role;
  Refuse("must be \"viewer\", \"editor\", \"operator\" or \"admin\"");
}

std::filesystem::path File(const Entry& entry) {
  const std::filesystem::path path = entry.Text();
  if (!path.is_absolute()) Refuse("must be an absolute path");
  return path;
}

CertificateRole Client(const toml::node& client) {
  const toml::table* table = client.as_table();
  if (!table) Refuse("must be [[tls.client]] with san and role");
  CertificateRole parsed;
  for (const auto& [name, node] : *table) {
    if (name == "san") {
      parsed.san = Entry{node}.Text();
    } else if (name == "role") {
      parsed.role = ParseRole({node});
    } else {
      Refuse("has san and role, and no " + std::string(name.str()));
    }
  }
  if (parsed.san.empty() || !table->contains("role")) Refuse("needs san and role");
  return parsed;
}

std::vector<CertificateRole> Clients(const Entry& entry) {
  const toml::array* array = entry.node.as_array();
  if (!array) Refuse("must be [[tls.client]] with san and role");
  std::vector<CertificateRole> clients;
  for (const toml::node& node : *array) clients.push_back(Client(node));
  return clients;
}

using E = const Entry&;
using C = Config&;
using Setters = std::map<std::string, std::function<void(E, C)>, std::less<>>;

Setters SourceSetters() {
  return {
      {"volume.isovalue", [](E e, C c) { c.volume.isovalue = e.Number(); }},
      {"volume.normalized_isovalue", [](E e, C c) { c.volume.normalized_isovalue = e.Number(); }},
      {"volume.spacing_mm", [](E e, C c) { c.volume.spacing_mm = e.Triple(); }},
      {"volume.frame", [](E e, C c) { c.volume.frame = e.Integer(0, 1 << 30); }},
      {"volume.grid", [](E e, C c) { c.volume.grid = e.Text(); }},
      {"volume.component", [](E e, C c) { c.volume.component = e.Text(); }},
      {"volume.raw_size", [](E e, C c) { Raw(c).size = RawSize(e); }},
      {"volume.raw_type",
       [](E e, C c) {
         Raw(c).type = OneOf(
             e, {"uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"});
       }},
      {"volume.raw_big_endian", [](E e, C c) { Raw(c).big_endian = e.Flag(); }},
      {"volume.raw_offset_bytes", [](E e, C c) { Raw(c).offset_bytes = e.Integer(0, 1 << 30); }},
  };
}

Setters VolumeSetters() {
  return {
      {"volume.source", [](E e, C c) { c.volume.source = e.Text(); }},
      {"volume.device_mm_per_volume_mm",
       [](E e, C c) { c.volume.device_mm_per_volume_mm = e.Number(); }},
      {"volume.load_folders", [](E e, C c) { c.load_folders = Folders(e); }},
      {"volume.save_folders", [](E e, C c) { c.save_folders = Folders(e); }},
      {"volume.upload_folder", [](E e, C c) { c.uploads.folder = e.Text(); }},
      {"volume.max_upload_mib", [](E e, C c) { c.uploads.max_bytes = Mebibytes(e); }},
      {"volume.upload_vdb", [](E e, C c) { c.uploads.vdb = e.Flag(); }},
      {"volume.memory_budget_mib", [](E e, C c) { c.memory_budget_bytes = Mebibytes(e); }},
  };
}

Setters HapticsSetters() {
  Setters setters;
  for (const NumberSetting& setting : kNumberSettings) {
    setters["haptics." + std::string(setting.key)] = [&setting](E e, C c) {
      const double value = e.Number();
      if (!setting.Allows(value)) {
        Refuse(fmt::format("must be {} from {} to {}{}", setting.what(), setting.low, setting.high,
                           setting.unit));
      }
      c.haptics.*setting.member = value;
    };
  }
  for (const FlagSetting& setting : kFlagSettings) {
    setters["haptics." + std::string(setting.key)] = [&setting](E e, C c) {
      c.haptics.*setting.member = e.Flag();
    };
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    setters["haptics." + std::string(setting.key)] = [&setting](E e, C c) {
      const std::string word = e.Text();
      const std::optional<int> number = NumberOf(setting, word);
      if (!number) {
        Refuse(fmt::format("must be {}, not \"{}\"", fmt::join(setting.words, " or "), word));
      }
      setting.set(c.haptics, *number);
    };
  }
  setters["haptics.layer"] = [](E e, C c) {
    c.haptics.layers = LayersFromToml(e.node);
    SurfaceLayers checked = c.haptics.layers;
    OrderLayers({}, checked);
  };
  return setters;
}

std::uint16_t Port(E e) { return static_cast<std::uint16_t>(e.Integer(1, 65535)); }

Setters DeviceSetters() {
  return {
      {"device.kind", [](E e, C c) { c.device.kind = e.Text(); }},
      {"device.pressed_buttons", [](E e, C c) { c.device.pressed_buttons = e.Integer(0, 3); }},
      {"device.torque_n_mm", [](E e, C c) { c.device.torque_n_mm = e.NumberWithin(0.0, 50.0); }},
      {"device.serial", [](E e, C c) { c.device.serial = e.Text(); }},
      {"device.stop_buttons", [](E e, C c) { c.device.stop_buttons = e.Integer(0, 15); }},
      {"device.replay_file", [](E e, C c) { c.device.replay_file = e.Text(); }},
      {"device.usb_port", [](E e, C c) { c.device.usb_port = e.Text(); }},
      {"device.frames",
       [](E, C) {
         Refuse(
             "is no key any more: the servo frames of a Touch on USB are not public, and palpated "
             "sends no guessed ones; use kind = \"openhaptics\", with the vendor's driver");
       }},
      {"device.motor_counts_per_n_mm",
       [](E e, C c) {
         const Vec3 counts = e.Triple();
         c.device.motor_counts_per_n_mm = {counts.x(), counts.y(), counts.z()};
       }},
      {"device.falcon_firmware", [](E e, C c) { c.device.falcon_firmware = e.Text(); }},
      {"device.openhaptics_library", [](E e, C c) { c.device.openhaptics_library = e.Text(); }},
      {"device.openhaptics_name", [](E e, C c) { c.device.openhaptics_name = e.Text(); }},
      {"device.forcedimension_library",
       [](E e, C c) { c.device.forcedimension.library = e.Text(); }},
      {"device.forcedimension_model",
       [](E e, C c) { c.device.forcedimension.model = FdModelOf(e.Text()).name; }},
      {"device.forcedimension_gripper_button",
       [](E e, C c) { c.device.forcedimension.gripper_button = e.Flag(); }},
      {"device.forcedimension_without_watchdog",
       [](E e, C c) { c.device.forcedimension.without_watchdog = e.Flag(); }},
      {"device.haply_model",
       [](E e, C c) {
         c.device.haply.model = e.Text();
         HaplySpec(c.device.haply.model);
       }},
      {"device.haply_grip", [](E e, C c) { c.device.haply.grip = e.Text(); }},
      {"device.haply_port", [](E e, C c) { c.device.haply.port = Port(e); }},
      {"device.haply_events_port", [](E e, C c) { c.device.haply.events_port = Port(e); }},
      {"realtime.priority", [](E e, C c) { c.realtime.priority = e.Integer(1, 99); }},
      {"realtime.cpu", [](E e, C c) { c.realtime.cpu = e.Integer(-1, 1023); }},
      {"realtime.lock_memory", [](E e, C c) { c.realtime.lock_memory = e.Flag(); }},
  };
}

Setters ServerSetters() {
  constexpr int kMost = 1'000'000;
  return {
      {"server.socket", [](E e, C c) { c.socket_path = e.Text(); }},
      {"server.operator_group", [](E e, C c) { c.groups.operators = e.Text(); }},
      {"server.editor_group", [](E e, C c) { c.groups.editors = e.Text(); }},
      {"server.viewer_group", [](E e, C c) { c.groups.viewers = e.Text(); }},
      {"server.door_group", [](E e, C c) { c.groups.door = e.Text(); }},
      {"server.listen", [](E e, C c) { c.listen = ParseHostPort(e.Text()); }},
      {"server.socket_role", [](E e, C c) { c.security.policy.socket_role = ParseRole(e); }},
      {"server.loopback_role", [](E e, C c) { c.security.policy.loopback_role = ParseRole(e); }},
      {"tls.certificate", [](E e, C c) { c.security.tls.certificate = File(e); }},
      {"tls.key", [](E e, C c) { c.security.tls.key = File(e); }},
      {"tls.client_ca", [](E e, C c) { c.security.policy.client_ca = File(e); }},
      {"tls.tokens", [](E e, C c) { c.security.policy.tokens = File(e); }},
      {"tls.client", [](E e, C c) { c.security.policy.clients = Clients(e); }},
      {"limits.connections", [](E e, C c) { c.security.connections = e.Integer(1, kMost); }},
      {"limits.calls_per_s", [](E e, C c) { c.security.limits.calls_per_s = e.Integer(1, kMost); }},
      {"limits.pose_streams",
       [](E e, C c) { c.security.limits.pose_streams = e.Integer(1, kMost); }},
      // At least one stream at 1 kHz of a network client. Network clients get half of the limit.
      {"limits.pose_samples_per_s",
       [](E e, C c) { c.security.limits.pose_samples_per_s = e.Integer(2000, kMost); }},
      {"limits.volume_streams",
       [](E e, C c) { c.security.limits.volume_streams = e.Integer(1, kMost); }},
      {"limits.transfers", [](E e, C c) { c.security.limits.transfers = e.Integer(1, kMost); }},
      {"metrics.listen", [](E e, C c) { c.metrics_listen = ParseHostPort(e.Text()); }},
      {"state.folder", [](E e, C c) { c.state_folder = e.Text(); }},
      {"state.fresh", [](E e, C c) { c.fresh = e.Flag(); }},
      {"log.level", [](E e, C c) { c.log_level = LogLevelName(e); }},
  };
}

// By the full key, for example "tls.certificate".
const std::map<std::string, ConfigSetter, std::less<>>& ConfigSetters() {
  static const auto all = [] {
    std::map<std::string, ConfigSetter, std::less<>> made;
    for (const Setters& setters :
         {SourceSetters(), VolumeSetters(), HapticsSetters(), DeviceSetters(), ServerSetters()}) {
      for (const auto& [key, set] : setters) {
        made[key] = [set = set](const toml::node& node, Config& config) { set({node}, config); };
      }
    }
    return made;
  }();
  return all;
}

// True if the key describes the file of volume.source, and not another one.
bool IsOfSource(std::string_view key) {
  static const Setters of_source = SourceSetters();
  return of_source.contains(key);
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
  for (const auto& [key, set] : ConfigSetters()) tables.insert(key.substr(0, key.find('.')));
  return tables;
}

bool IsIsovalue(std::string_view key) {
  return key == "volume.isovalue" || key == "volume.normalized_isovalue";
}

class Reader {
 public:
  Reader(const ConfigOverrides& overrides, Config& config)
      : overrides_(overrides), config_(config) {}

  void ReadFile(const std::filesystem::path& path) {
    try {
      ReadTable(toml::parse_file(path.string()), "");
    } catch (const toml::parse_error& error) {
      const std::size_t line = error.source().begin.line;
      const std::string what = OneLine(error.description());
      // Line 0: the file cannot be opened.
      reading_.faults.push_back({"", line, line > 0 ? what : path.string() + ": " + what});
    }
  }
  void ReadOverrides() {
    for (const ConfigOverride& one : overrides_) {
      toml::array node;  // of one
      std::visit([&](const auto& given) { Append(given, node); }, one.value);
      Set(one.key, node[0], config_);
    }
  }
  ConfigReading Take() { return std::move(reading_); }

 private:
  template <class T>
  static void Append(const T& value, toml::array& to) {
    to.push_back(value);
  }
  template <class T>
  static void Append(const std::vector<T>& values, toml::array& to) {
    toml::array list;
    for (const T& value : values) list.push_back(value);
    to.push_back(std::move(list));
  }

  void ReadTable(const toml::table& table, const std::string& prefix) {
    for (const auto& [name, node] : table) {
      const std::string key = prefix + std::string(name.str());
      const std::size_t line = node.source().begin.line;
      const toml::table* const section = node.as_table();
      if (section && !Tables().contains(key)) {
        reading_.faults.push_back(
            {key, line,
             fmt::format("is no table of palpated: there are {}", fmt::join(Tables(), ", "))});
      } else if (section) {
        ReadTable(*section, key + ".");
      } else if (IsReplaced(key)) {
        Config unused;
        Set(key, node, unused);
      } else if (Set(key, node, config_)) {
        reading_.keys[key] = {line, Value(node)};
      }
    }
  }

  bool IsReplaced(const std::string& key) const {
    return std::any_of(overrides_.begin(), overrides_.end(), [&](const ConfigOverride& one) {
      return key == one.key || (IsIsovalue(key) && IsIsovalue(one.key)) ||
             (one.key == "volume.source" && IsOfSource(key));
    });
  }

  bool Set(const std::string& key, const toml::node& node, Config& config) {
    try {
      const auto setter = ConfigSetters().find(key);
      if (setter == ConfigSetters().end()) Refuse("is no setting of palpated");
      setter->second(node, config);
      return true;
    } catch (const Error& error) {
      reading_.faults.push_back({key, node.source().begin.line, error.what()});
      return false;
    }
  }

  const ConfigOverrides& overrides_;
  Config& config_;
  ConfigReading reading_;
};

// True if `what` continues a sentence that begins with the key.
bool GoesOn(std::string_view what) {
  return what.starts_with("must ") || what.starts_with("is ") || what.starts_with("has ") ||
         what.starts_with("needs ");
}

}  // namespace

ConfigReading ReadConfig(const std::filesystem::path& path, const ConfigOverrides& overrides,
                         Config& config) {
  Reader reader(overrides, config);
  if (!path.empty()) reader.ReadFile(path);
  reader.ReadOverrides();
  return reader.Take();
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
