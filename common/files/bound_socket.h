// A Unix socket of a name, for its owner and group alone.
//
// Threads: any. Errors: -1 with errno.
#pragma once

#include <sys/types.h>

#include <string>

namespace palpate {

// Returns a socket that is bound to `path` and does not listen yet. Where the kernel can, its
// connections take no files. The caller closes it, and removes the file.
int BindSocket(const std::string& path, mode_t mode = 0660);

// Gives the file of a bound socket to a group. Errors: Error (kPermissionDenied) that says what to
// do; then the file is gone.
void GiveToGroup(const std::string& path, gid_t group);

}  // namespace palpate
