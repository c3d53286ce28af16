// Opens what was judged, and nothing that somebody has put in its place since.
//
// Any thread.
#pragma once

#include <filesystem>

namespace palpate {

// As open(), but fails with ELOOP where a link is on the way. Absolute paths. Returns the
// descriptor, which is the caller's; -1: errno says why.
int OpenPlain(const std::filesystem::path& path, int flags);

// A path of an open file, wherever its name leads by now.
std::filesystem::path ByDescriptor(int descriptor);

// Where an open file lies now; empty where that is not known.
std::filesystem::path RealPath(int descriptor);

}  // namespace palpate
