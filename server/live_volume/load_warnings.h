// Prepares the warnings of an import for clients.
//
// Threads: any. Errors: none.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

// Removes the name of `source` from the start of each warning, because clients know the source
// under another name. Each line is UTF-8 of at most 300 bytes. Returns at most 16 lines; if there
// are more warnings, the last line counts the rest.
std::vector<std::string> WarningsForClients(std::span<const std::string> warnings,
                                            std::string_view source);

}  // namespace palpate
