// The warnings of an import, as clients are told them.
//
// Threads: any. Errors: none.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

// `warnings` without the name of `source` in front, which clients know under another name. Each is
// one line of UTF-8 of at most 300 bytes. At most 16 lines: where there are more, the last one
// counts the rest.
std::vector<std::string> WarningsForClients(std::span<const std::string> warnings,
                                            std::string_view source);

}  // namespace palpate
