// Names of blobs: a content hash as 32 hex digits, the high half first.
//
// Threads: pure.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "common/bricks/brick.h"

namespace palpate::web {

std::string NameOf(const ContentHash& hash);
// None if it is no name: other than 32 digits, capital letters.
std::optional<ContentHash> ParseName(std::string_view name);
// Its 16 bytes in the order of the name's digits.
std::array<char, 16> BytesOf(const ContentHash& hash);
std::string Base64(std::string_view bytes);

}  // namespace palpate::web
