// A Unix socket of a name, for its owner and group alone.
//
// Threads: any. Errors: -1 with errno.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

namespace palpate {

// Returns a socket that is bound to `path`, with the mode 0660, and does not listen yet. Where the
// kernel can, its connections take no files. `group`: owns the file; none: as every file that the
// process makes. The caller closes it, and removes the file.
int BindSocket(const std::string& path, std::optional<gid_t> group = {});

}  // namespace palpate
