// Where the daemon keeps what outlives it, unless the configuration names a folder.
#pragma once

#include <string>

namespace palpate {

// $STATE_DIRECTORY (systemd's; the first of several), $XDG_STATE_HOME/palpate, or
// ~/.local/state/palpate; empty where none of them is an absolute path. Any thread
// while none changes the environment.
std::string DefaultStateFolder();

}  // namespace palpate
