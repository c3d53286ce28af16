// Opens a checked path, and not a link that has since been put in its place.
//
// Any thread.
#pragma once

#include <filesystem>

namespace palpate {

// Like open(), but fails with ELOOP if a link is on the way. For absolute paths. Returns a
// descriptor that the caller owns, or -1; errno then says why.
int OpenPlain(const std::filesystem::path& path, int flags);

// Returns a path that leads to an open file, even if its name now leads elsewhere.
std::filesystem::path ByDescriptor(int descriptor);

// Returns the present path of an open file, or "" if it is not known.
std::filesystem::path RealPath(int descriptor);

}  // namespace palpate
