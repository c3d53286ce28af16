// The files and folders of this daemon, and those that clients may name.
//
// Threads: main.
#pragma once

#include <filesystem>
#include <string>

#include "server/app/config.h"
#include "server/client_paths/path_policy.h"

namespace palpate {

struct DaemonPaths {
  explicit DaemonPaths(const LoadedConfig& loaded);

  // For the next start; empty: nothing is kept. Unless the configuration names it:
  // $STATE_DIRECTORY (systemd's; the first of several), $XDG_STATE_HOME/palpate or
  // ~/.local/state/palpate, whichever is an absolute path.
  std::filesystem::path state_folder;
  std::string socket;
  OwnFiles own_files;  // clients may neither load nor overwrite these
  PathPolicy clients;
};

}  // namespace palpate
