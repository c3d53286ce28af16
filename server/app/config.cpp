#include "server/app/config.h"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <functional>
#include <map>
#include <string_view>

#include "common/error/error.h"

namespace palpate {
namespace {

// A value of the file, with what an error message needs.
struct Entry {
  std::string file;
  std::string key;
  const toml::node& node;

  [[noreturn]] void Fail(const std::string& what) const {
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("{}:{}: {} {}", file, node.source().begin.line, key, what));
  }
  std::string Text() const {
    if (const auto value = node.value_exact<std::string>()) return *value;
    Fail("must be a text in quotes");
  }
  double Number() const {
    if (node.is_number()) return *node.value<double>();
    Fail("must be a number");
  }
  int Integer(int low, int high) const {
    const auto value = node.value_exact<std::int64_t>();
    if (value && *value >= low && *value <= high) return static_cast<int>(*value);
    Fail(fmt::format("must be a whole number from {} to {}", low, high));
  }
  bool Flag() const {
    if (const auto value = node.value_exact<bool>()) return *value;
    Fail("must be true or false");
  }
  Vec3 Triple() const {
    const toml::array* array = node.as_array();
    if (!array || array->size() != 3) Fail("must be three numbers, [x, y, z]");
    Vec3 v;
    for (std::size_t n = 0; n < 3; ++n) {
      if (!(*array)[n].is_number()) Fail("must be three numbers, [x, y, z]");
      v[static_cast<Eigen::Index>(n)] = *(*array)[n].value<double>();
    }
    return v;
  }
};

using Paths = std::vector<std::filesystem::path>;

// A folder that is there.
std::filesystem::path ParseFolder(const Entry& entry) {
  const std::filesystem::path folder = entry.Text();
  PathPolicy({.load_folders = {folder}});  // throws
  return folder;
}

// The same of several.
Paths ParseFolders(const Entry& entry) {
  const toml::array* array = entry.node.as_array();
  if (!array) entry.Fail("must be a list of paths, [\"/data\"]");
  Paths folders;
  for (const toml::node& element : *array) {
    const auto text = element.value_exact<std::string>();
    if (!text) entry.Fail("must be a list of paths, [\"/data\"]");
    folders.emplace_back(*text);
  }
  PathPolicy({.load_folders = folders});  // throws
  return folders;
}

std::uint64_t Mebibytes(const Entry& entry) {
  return static_cast<std::uint64_t>(entry.Integer(1, 1 << 30)) << 20;
}

using Setter = std::function<void(const Entry&, Config&)>;
using SettersByKey = std::map<std::string, Setter, std::less<>>;

FreeSide ParseFreeSide(const Entry& entry) {
  if (const auto side = FreeSideNamed(entry.Text())) return *side;
  entry.Fail("must be \"below\" or \"above\"");
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
      // False for NaN.
      if (!(value >= setting.low && value <= setting.high)) {
        e.Fail(fmt::format("must be from {} to {}{}", setting.low, setting.high, setting.unit));
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
    entry.Fail("must be \"none\" or \"framed-firewire\"");
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
  if (!array) entry.Fail("must be a list of bytes, [0x01, 0xff]");
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

SettersByKey AllSetters() {
  SettersByKey setters = {
      {"volume.source", [](const Entry& e, Config& c) { c.volume = e.Text(); }},
      {"volume.isovalue", [](const Entry& e, Config& c) { c.isovalue = e.Number(); }},
      {"volume.normalized_isovalue",
       [](const Entry& e, Config& c) { c.normalized_isovalue = e.Number(); }},
      {"volume.spacing_mm", [](const Entry& e, Config& c) { c.spacing_mm = e.Triple(); }},
      {"volume.device_mm_per_volume_mm",
       [](const Entry& e, Config& c) { c.device_mm_per_volume_mm = e.Number(); }},
      {"volume.load_folders", [](const Entry& e, Config& c) { c.load_folders = ParseFolders(e); }},
      {"volume.save_folders", [](const Entry& e, Config& c) { c.save_folders = ParseFolders(e); }},
      {"volume.upload_folder",
       [](const Entry& e, Config& c) { c.uploads.folder = ParseFolder(e); }},
      {"volume.max_upload_mib",
       [](const Entry& e, Config& c) { c.uploads.max_bytes = Mebibytes(e); }},
      {"volume.memory_budget_mib",
       [](const Entry& e, Config& c) { c.memory_budget_bytes = Mebibytes(e); }},
      {"server.socket", [](const Entry& e, Config& c) { c.socket_path = e.Text(); }},
      {"server.listen", [](const Entry& e, Config& c) { c.listen = ParseHostPort(e.Text()); }},
      {"state.folder", [](const Entry& e, Config& c) { c.state_folder = e.Text(); }},
      {"realtime.priority",
       [](const Entry& e, Config& c) { c.realtime.priority = e.Integer(1, 99); }},
      {"realtime.cpu", [](const Entry& e, Config& c) { c.realtime.cpu = e.Integer(-1, 1023); }},
      {"realtime.lock_memory",
       [](const Entry& e, Config& c) { c.realtime.lock_memory = e.Flag(); }},
  };
  setters.merge(HapticsSetters());
  setters.merge(DeviceSetters());
  return setters;
}

const SettersByKey& Setters() {
  static const SettersByKey setters = AllSetters();
  return setters;
}

void Apply(const std::string& file, const toml::table& table, const std::string& prefix,
           Config& config) {
  for (const auto& [name, node] : table) {
    const Entry entry{file, prefix + std::string(name.str()), node};
    if (const toml::table* section = node.as_table()) {
      Apply(file, *section, entry.key + ".", config);
      continue;
    }
    const auto setter = Setters().find(entry.key);
    if (setter == Setters().end()) entry.Fail("is no setting of palpated");
    try {
      setter->second(entry, config);
    } catch (const Error& error) {
      const std::string_view what = error.what();
      if (what.starts_with(file)) throw;
      entry.Fail(": " + std::string(what));
    }
  }
}

}  // namespace

DecompositionMethod ParseMethod(const std::string& name) {
  if (const auto method = MethodNamed(name)) return *method;
  throw Error(ErrorKind::kInvalidArgument,
              "unknown method " + name + ": give tpbcc, bcc, tptd or tpbcc-published");
}

void ReadConfigFile(const std::filesystem::path& path, Config& config) {
  try {
    Apply(path.string(), toml::parse_file(path.string()), "", config);
  } catch (const toml::parse_error& error) {
    throw Error(
        ErrorKind::kInvalidArgument,
        fmt::format("{}:{}: {}", path.string(), error.source().begin.line, error.description()));
  }
}

}  // namespace palpate
