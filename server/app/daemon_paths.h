// The files and folders of this daemon, and those that clients may name.
//
// Threads: main.
#pragma once

#include <filesystem>
#include <string>

#include "server/app/config.h"
#include "server/client_files/path_policy.h"

namespace palpate {

struct DaemonPaths {
  explicit DaemonPaths(const LoadedConfig& loaded);

  std::filesystem::path state_folder;  // empty: nothing is kept
  std::string socket;
  OwnFiles own_files;  // clients may neither load nor overwrite these
  PathPolicy clients;
};

}  // namespace palpate
