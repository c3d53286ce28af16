// Finds faults of a configuration before anything is opened or loaded. Used at start, for `palpated
// --check-config`, and when a running daemon reads its configuration again.
//
// Threads: main. Asks the file system with the rights of the calling user. Opens no device.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/app/config.h"

namespace palpate {

// A configuration that cannot be used. what() is the first fault, kind() is the kind of that fault.
class ConfigError : public Error {
 public:
  ConfigError(const std::filesystem::path& file, const std::vector<ConfigFault>& faults);
  // One line for each fault, in the file's order.
  const std::vector<std::string>& lines() const { return lines_; }

 private:
  std::vector<std::string> lines_;
};

// kReload: volumes and device files may be missing, because only a start reads them.
enum class ConfigUse { kStart, kReload };

// Returns faults of the whole configuration: files that are missing or invalid, values that
// contradict each other, values out of range. Takes the line numbers from `keys`. `known`: the
// faults found so far; consequences of these faults are not reported.
std::vector<ConfigFault> CheckConfig(const Config& config, const ConfigKeys& keys,
                                     ConfigUse use = ConfigUse::kStart,
                                     const std::vector<ConfigFault>& known = {});

// Reads and checks `file` with the command line's values in place of the file's. An empty `file`
// means the command line alone. Throws ConfigError.
LoadedConfig LoadConfig(const std::filesystem::path& file, const ConfigOverrides& overrides = {},
                        ConfigUse use = ConfigUse::kStart);

// Prints a line for each fault, or "FILE: ok". Returns the exit code.
int CheckConfigFile(const std::filesystem::path& file, const ConfigOverrides& overrides);

}  // namespace palpate
