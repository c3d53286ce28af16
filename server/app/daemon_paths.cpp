#include "server/app/daemon_paths.h"

#include <cstdlib>
#include <vector>

#include "common/wire/address.h"

namespace palpate {
namespace {

// Empty if the variable is not set or holds no absolute path. Both systemd and the XDG base
// directory specification ask for absolute paths.
std::string Folder(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr && value[0] == '/' ? value : "";
}

std::string DefaultStateFolder() {
  const std::string state = Folder("STATE_DIRECTORY");
  if (!state.empty()) return state.substr(0, state.find(':'));
  const std::string xdg = Folder("XDG_STATE_HOME");
  if (!xdg.empty()) return xdg + "/palpate";
  const std::string home = Folder("HOME");
  return home.empty() ? "" : home + "/.local/state/palpate";
}

OwnFiles OwnFilesOf(const LoadedConfig& loaded, const std::filesystem::path& state_folder,
                    const std::string& socket) {
  const SecurityOptions& security = loaded.config.security;
  std::vector<std::filesystem::path> own{socket + ".tls", socket + ".lock",
                                         StopSocketPath(socket) + ".lock"};
  // Not the whole folder: recordings may lie below it. The service's recordings do.
  if (!state_folder.empty()) {
    for (const char* name : {"sessions", "faults", "registrations.toml", "registrations.toml.lock",
                             "registrations.toml.damaged"}) {
      own.push_back(std::filesystem::absolute(state_folder) / name);
    }
  }
  for (const std::filesystem::path& path :
       {loaded.file, security.policy.tokens, security.policy.client_ca, security.tls.certificate,
        security.tls.key}) {
    if (!path.empty()) own.push_back(std::filesystem::absolute(path));
  }
  return OwnFiles(own);
}

PathPolicy PolicyOf(const Config& config, const OwnFiles& own_files) {
  const auto or_current = [](const std::optional<std::vector<std::filesystem::path>>& folders) {
    return folders ? *folders : std::vector{CurrentFolder()};
  };
  return PathPolicy({.load_folders = or_current(config.load_folders),
                     .save_folders = or_current(config.save_folders),
                     .own_files = own_files});
}

}  // namespace

DaemonPaths::DaemonPaths(const LoadedConfig& loaded)
    : state_folder(loaded.config.state_folder.value_or(DefaultStateFolder())),
      socket(loaded.config.socket_path.empty() ? DefaultSocketPath() : loaded.config.socket_path),
      own_files(OwnFilesOf(loaded, state_folder, socket)),
      clients(PolicyOf(loaded.config, own_files)) {}

}  // namespace palpate
