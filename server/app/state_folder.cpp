#include "server/app/state_folder.h"

#include <cstdlib>

namespace palpate {
namespace {

// Empty if the variable is not set or holds no absolute path. Both systemd and the XDG base
// directory specification ask for absolute paths.
std::string Folder(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr && value[0] == '/' ? value : "";
}

}  // namespace

std::string DefaultStateFolder() {
  const std::string state = Folder("STATE_DIRECTORY");
  if (!state.empty()) return state.substr(0, state.find(':'));
  const std::string xdg = Folder("XDG_STATE_HOME");
  if (!xdg.empty()) return xdg + "/palpate";
  const std::string home = Folder("HOME");
  return home.empty() ? "" : home + "/.local/state/palpate";
}

}  // namespace palpate
