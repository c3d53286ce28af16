// Where the daemon keeps files for its next start, unless the configuration names a folder.
#pragma once

#include <string>

namespace palpate {

// Returns $STATE_DIRECTORY (set by systemd; the first folder of several), else
// $XDG_STATE_HOME/palpate, else ~/.local/state/palpate. Returns "" if none of the three is an
// absolute path. Any thread, while no thread changes the environment.
std::string DefaultStateFolder();

}  // namespace palpate
