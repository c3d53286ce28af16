// The configuration of palpated at start: a TOML file, and the command line, which overrides the
// file.
//
// Threads: main. Errors: faults, each with its line and key.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/error/error.h"
#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "common/wire/address.h"
#include "server/client_paths/upload.h"
#include "server/device/forcedimension/forcedimension_bus.h"
#include "server/device/haply/haply_bus.h"
#include "server/haptics/settings.h"
#include "server/live_volume/memory_budget.h"
#include "server/live_volume/volume_loader.h"
#include "server/realtime/thread_setup.h"
#include "server/services/server.h"

namespace palpate {

// Selects the device that the daemon drives, and holds the options of each device.
//
// Threads: main, at start.
struct DeviceConfig {
  std::string kind = "simulated";  // see MakeDevice()
  int pressed_buttons = 0;         // for the simulated device, see PressScript
  double torque_n_mm = 0.0;        // for the simulated device: its greatest
  std::string serial;              // "": the only device
  // Buttons that stop the forces while all of them are held. Absent: both buttons of hardware, and
  // no buttons of a simulated device.
  std::optional<std::uint32_t> stop_buttons;
  std::string replay_file;      // for `replay`: a recording
  std::string usb_port;         // for example "1-2"; "": the only device
  std::string falcon_firmware;  // for `falcon`: a file
  // For `omni-firewire`, see OmniArm. Absent: its motors stay off.
  std::optional<std::array<double, 3>> motor_counts_per_n_mm;
  std::string openhaptics_library;       // for `openhaptics`; "": the system searches for libHD.so
  std::string openhaptics_name;          // as in the vendor's set-up; "": the vendor's default
  ForceDimensionOptions forcedimension;  // without its serial number
  HaplyOptions haply;                    // without its serial number
};

struct Config {
  // Without an isovalue: as ValuesOf suggests. The title is not set; see ConfiguredVolume().
  LoadRequest volume{.source = "builtin:bumps"};
  // Absent: the folder in which palpated was started.
  std::optional<std::vector<std::filesystem::path>> load_folders;
  std::optional<std::vector<std::filesystem::path>> save_folders;
  std::uint64_t memory_budget_bytes = DefaultMemoryBudget();
  UploadOptions uploads;
  HapticSettings haptics;
  DeviceConfig device;
  std::string socket_path;  // empty: DefaultSocketPath()
  SocketGroups groups;
  std::optional<HostPort> listen;
  SecurityOptions security;
  std::optional<HostPort> metrics_listen;  // absent: no metrics
  RealtimeOptions realtime;
  // Where the daemon keeps files for its next start. Empty: nowhere. Absent: see DaemonPaths.
  std::optional<std::string> state_folder;
  bool fresh = false;              // starts as configured, whatever was set before
  std::string log_level = "info";  // one of kLogLevels
};

// A value of the command line, which stands in place of the file's.
struct ConfigOverride {
  std::string option;  // "--volume", for messages
  std::string key;     // "volume.source"
  std::variant<std::string, bool, std::int64_t, double, std::vector<double>,
               std::vector<std::string>>
      value;
};
using ConfigOverrides = std::vector<ConfigOverride>;

// A key that stands in the file.
struct ConfigKey {
  std::size_t line = 0;
  std::string value;  // as TOML
};
using ConfigKeys = std::map<std::string, ConfigKey, std::less<>>;

// What is wrong with a key. An empty key: what is wrong with the whole file.
struct ConfigFault {
  std::string key;
  std::size_t line = 0;  // 0: the key is not in the file
  std::string what;      // "must be from 0 to 3 N", or "cannot read FILE: ..."
  ErrorKind kind = ErrorKind::kInvalidArgument;
};

struct ConfigReading {
  ConfigKeys keys;  // the keys that were read
  std::vector<ConfigFault> faults;
};

// A configuration, and the keys that it takes from the file. Keys that the command line overrides
// are not in `keys`.
struct LoadedConfig {
  Config config;
  ConfigKeys keys;
  std::filesystem::path file;  // empty: none
};

// Reads the keys of `path` into `config`, and then the overrides. Keys that neither names keep
// their value. An override of volume.source also replaces all keys that describe the file's volume
// (IsOfSource); one form of the isovalue replaces the other. Invalid values are left out and
// reported as faults. Opens no other file. An empty `path`: the overrides alone.
ConfigReading ReadConfig(const std::filesystem::path& path, const ConfigOverrides& overrides,
                         Config& config);

// Returns "FILE:LINE: KEY: WHAT", or "KEY WHAT" if the two form a sentence. Leaves out FILE:LINE if
// no line is to blame.
std::string ToText(const std::filesystem::path& path, const ConfigFault& fault);

// Returns `error` as a fault of `key` if the key is in the file; otherwise returns `error`.
Error AtKey(const LoadedConfig& loaded, std::string_view key, const Error& error);

}  // namespace palpate
