// What palpated is told at start: a TOML file, and the command line over it.
//
// Threads: main. Errors: Error (kInvalidArgument) that names file, line and key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "common/wire/address.h"
#include "server/app/device_config.h"
#include "server/haptics/settings.h"
#include "server/realtime/thread_setup.h"
#include "server/rpc/server.h"
#include "server/session/memory_budget.h"
#include "server/session/path_policy.h"
#include "server/session/upload.h"

namespace palpate {

struct Config {
  std::string volume = "builtin:bumps";
  std::optional<double> isovalue;             // data units
  std::optional<double> normalized_isovalue;  // 0 to 1; neither: 0.5
  std::optional<Vec3> spacing_mm;
  std::optional<double> device_mm_per_volume_mm;
  std::vector<std::filesystem::path> load_folders = PathPolicyOptions{}.load_folders;
  std::optional<std::vector<std::filesystem::path>> save_folders;  // none: the current one
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
  std::size_t line = 0;  // 0: unknown
  std::string what;
};

struct ConfigReading {
  ConfigKeys keys;                  // those that were read
  std::vector<ConfigFault> faults;  // in the file's order
};

// Reads the keys of `path` into `config`; what the file does not name stays, and what
// is wrong is left out.
ConfigReading ReadConfig(const std::filesystem::path& path, Config& config);

// The same; throws the first fault.
ConfigKeys ReadConfigFile(const std::filesystem::path& path, Config& config);

// "FILE:LINE: KEY WHAT"
std::string ToText(const std::filesystem::path& path, const ConfigFault& fault);

DecompositionMethod ParseMethod(const std::string& name);

}  // namespace palpate
