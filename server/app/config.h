// What palpated is told at start: a TOML file, and the command line over it.
//
// Threads: main. Errors: faults, each with line and key.
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
  std::optional<double> normalized_isovalue;  // 0 to 1; neither: 0.5
  std::optional<Vec3> spacing_mm;
  std::optional<double> device_mm_per_volume_mm;
  std::string grid;       // of a .vdb file with several
  std::string component;  // of a grid of vectors
  // Absent: the folder that palpated is started in.
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
  // Where the daemon keeps what outlives it; empty: nowhere. Absent:
  // DefaultStateFolder().
  std::optional<std::string> state_folder;
  std::string log_level = "info";  // of kLogLevels
};

// A key that a file gives.
struct ConfigKey {
  std::size_t line = 0;
  std::string value;  // as TOML
};
using ConfigKeys = std::map<std::string, ConfigKey, std::less<>>;

// What is wrong with a key, or with the file where there is none.
struct ConfigFault {
  std::string key;
  std::size_t line = 0;  // 0: it does not stand in the file
  std::string what;      // "must be from 0 to 3 N", or "cannot read FILE: ..."
  ErrorKind kind = ErrorKind::kInvalidArgument;
};

struct ConfigReading {
  ConfigKeys keys;                  // those that were read
  std::vector<ConfigFault> faults;  // in the file's order
};

// A configuration, and what of it stands in the file; without keys that the command
// line overrides.
struct LoadedConfig {
  Config config;
  ConfigKeys keys;
  std::filesystem::path file;  // empty: none
};

// Reads the keys of `path` into `config`; what the file does not name stays, and what
// is wrong is left out. Opens no other file.
ConfigReading ReadConfig(const std::filesystem::path& path, Config& config);

// "FILE:LINE: KEY: WHAT", or "KEY WHAT" where that is a sentence; without the file where no line of
// it is to blame.
std::string ToText(const std::filesystem::path& path, const ConfigFault& fault);

// `error` as a fault of that key, if it stands in the file.
Error AtKey(const LoadedConfig& loaded, std::string_view key, const Error& error);

DecompositionMethod ParseMethod(const std::string& name);

}  // namespace palpate
