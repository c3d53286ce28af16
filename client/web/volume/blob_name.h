// Names of blobs: a content hash as 32 hex digits, the high half first.
//
// Threads: pure. Errors: as stated.
#pragma once

#include <array>
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
// Of exactly these 16 bytes.
ContentHash HashOf(std::string_view bytes);
std::string Base64(std::string_view bytes);
// Errors: kInvalidArgument (no base64 with its padding).
std::string FromBase64(std::string_view text);

}  // namespace palpate::web
