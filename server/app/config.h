// The configuration of palpated at start: a TOML file, and the command line, which overrides the
// file.
//
// Threads: main. Errors: faults, each with its line and key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/error/error.h"
#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "common/wire/address.h"
#include "server/app/device_config.h"
#include "server/haptics/settings.h"
#include "server/realtime/thread_setup.h"
#include "server/rpc/server.h"
#include "server/session/path_policy.h"
#include "server/session/upload.h"
#include "server/store/memory_budget.h"

namespace palpate {

struct Config {
  std::string volume = "builtin:bumps";
  std::optional<double> isovalue;             // data units
  std::optional<double> normalized_isovalue;  // 0 to 1; without both: as ValuesOf suggests
  std::optional<Vec3> spacing_mm;
  std::optional<double> device_mm_per_volume_mm;
  std::string grid;       // for a .vdb file with several grids
  std::string component;  // for a grid of vectors
  // Absent: the folder in which palpated was started.
  std::optional<std::vector<std::filesystem::path>> load_folders;
  std::optional<std::vector<std::filesystem::path>> save_folders;
  std::uint64_t memory_budget_bytes = DefaultMemoryBudget();
  UploadOptions uploads;
  HapticSettings haptics;
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  DeviceConfig device;
  std::string socket_path;  // empty: DefaultSocketPath()
  std::optional<HostPort> listen;
  SecurityOptions security;
  std::optional<HostPort> metrics_listen;  // absent: no metrics
  RealtimeOptions realtime;
  // Where the daemon keeps files for its next start. Empty: nowhere. Absent: DefaultStateFolder().
  std::optional<std::string> state_folder;
  std::string log_level = "info";  // one of kLogLevels
};

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
  ConfigKeys keys;                  // the keys that were read
  std::vector<ConfigFault> faults;  // in the file's order
};

// A configuration, and the keys that it takes from the file. Keys that the command line overrides
// are not in `keys`.
struct LoadedConfig {
  Config config;
  ConfigKeys keys;
  std::filesystem::path file;  // empty: none
};

// Reads the keys of `path` into `config`. Keys that the file does not name keep their value.
// Invalid values are left out and reported as faults. Opens no other file.
ConfigReading ReadConfig(const std::filesystem::path& path, Config& config);

// Returns "FILE:LINE: KEY: WHAT", or "KEY WHAT" if the two form a sentence. Leaves out FILE:LINE if
// no line is to blame.
std::string ToText(const std::filesystem::path& path, const ConfigFault& fault);

// Returns `error` as a fault of `key` if the key is in the file; otherwise returns `error`.
Error AtKey(const LoadedConfig& loaded, std::string_view key, const Error& error);

DecompositionMethod ParseMethod(const std::string& name);

}  // namespace palpate
