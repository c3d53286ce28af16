// What can be known to be wrong with a configuration before anything is opened or
// loaded: at start, for `palpated --check-config`, and for what is taken over while the
// daemon runs.
//
// Threads: main. Asks the file system, as the user who runs it; opens no device.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/app/config.h"

namespace palpate {

// A configuration that cannot be used. what() is the first fault, kind() its kind.
class ConfigError : public Error {
 public:
  ConfigError(const std::filesystem::path& file, const std::vector<ConfigFault>& faults);
  // One for each fault, in the file's order.
  const std::vector<std::string>& lines() const { return lines_; }

 private:
  std::vector<std::string> lines_;
};

// kReload: volumes and files of devices, which are read at the start alone, may be gone.
enum class ConfigUse { kStart, kReload };

// Faults of whole configurations: files that are not there or not fit, values that do
// not go together or are out of range. Lines are those of `keys`. `known`: what was found
// wrong before; what would only follow from that is left out.
std::vector<ConfigFault> CheckConfig(const Config& config, const ConfigKeys& keys,
                                     ConfigUse use = ConfigUse::kStart,
                                     const std::vector<ConfigFault>& known = {});

// Lays the command line over what a file says, and takes out the keys that it overrides.
// May throw Error.
using ConfigMerge = std::function<void(LoadedConfig&)>;

// Reads and checks `file`; empty: the command line alone. Throws ConfigError.
LoadedConfig LoadConfig(const std::filesystem::path& file, const ConfigMerge& merge,
                        ConfigUse use = ConfigUse::kStart);

// Prints a line for each fault, or "FILE: ok". Returns the exit code.
int CheckConfigFile(const std::filesystem::path& file, const ConfigMerge& merge);

}  // namespace palpate
