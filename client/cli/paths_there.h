// Makes paths for a palpated, whose current folder is not ours. Any thread.
#pragma once

#include <string>

#include "client/sdk/calls.h"

namespace palpate::cli {

// `is_here`: palpated runs on this machine. `name`: palpated's name for people. Errors:
// kInvalidArgument for an empty path, and for a relative path if the daemon may be on another
// machine.
std::string PathThere(const std::string& path, bool is_here, const std::string& name);
std::string PathThere(const client::Calls& palpated, const std::string& path);
// The same for a volume's source. Names of builtin volumes are not changed.
std::string SourceThere(const client::Calls& palpated, const std::string& source);

}  // namespace palpate::cli
