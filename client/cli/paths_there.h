// Paths for a palpated, whose current folder is another one than ours. Any thread.
#pragma once

#include <string>

#include "client/sdk/calls.h"

namespace palpate::cli {

// `is_here`: palpated runs on this machine; `name`: of it, for people. Errors: kInvalidArgument for
// an empty path, and for a relative one where the daemon may be on another machine.
std::string PathThere(const std::string& path, bool is_here, const std::string& name);
std::string PathThere(const client::Calls& palpated, const std::string& path);
// The same, but for a builtin volume's name.
std::string SourceThere(const client::Calls& palpated, const std::string& source);

}  // namespace palpate::cli
