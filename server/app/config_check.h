// What can be known to be wrong with a configuration before anything is opened or
// loaded: for `palpated --check-config`, and for what is taken over while the daemon
// runs.
//
// Threads: main. Asks the file system; opens no device.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "server/app/config.h"

namespace palpate {

// Faults of whole configurations: files that are not there, values that do not go
// together. Lines are those of `keys`.
std::vector<ConfigFault> CheckConfig(const Config& config, const ConfigKeys& keys);

// Reads and checks `file`; prints a line for each fault, or "FILE: ok". `merge` lays the
// command line over what was read; it may throw Error. Returns the exit code.
int CheckConfigFile(const std::filesystem::path& file, const std::function<void(Config&)>& merge);

}  // namespace palpate
