#include "client/web/volume/blob_name.h"

#include <cstdint>

namespace palpate::web {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";

}  // namespace

std::array<char, 16> BytesOf(const ContentHash& hash) {
  std::array<char, 16> bytes;
  for (std::size_t n = 0; n < 16; ++n) {
    const std::uint64_t half = n < 8 ? hash.high : hash.low;
    bytes.at(n) = static_cast<char>(half >> (56 - 8 * (n % 8)) & 0xff);
  }
  return bytes;
}

std::string NameOf(const ContentHash& hash) {
  std::string name;
  for (const char byte : BytesOf(hash)) {
    const auto value = static_cast<std::uint8_t>(byte);
    name += kHexDigits[value >> 4];
    name += kHexDigits[value & 15];
  }
  return name;
}

std::optional<ContentHash> ParseName(std::string_view name) {
  if (name.size() != 32) return std::nullopt;
  ContentHash hash;
  for (std::size_t n = 0; n < 32; ++n) {
    const std::size_t digit = kHexDigits.find(name[n]);
    if (digit == std::string_view::npos) return std::nullopt;
    std::uint64_t& half = n < 16 ? hash.high : hash.low;
    half = half << 4 | digit;
  }
  return hash;
}

std::string Base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t n = 0; n < bytes.size(); n += 3) {
    std::uint32_t three = 0;
    for (std::size_t m = n; m < n + 3; ++m) {
      three = three << 8 | (m < bytes.size() ? static_cast<std::uint8_t>(bytes[m]) : 0);
    }
    for (std::size_t m = 0; m < 4; ++m) {
      text += n + m <= bytes.size() ? kDigits[three >> (18 - 6 * m) & 63] : '=';
    }
  }
  return text;
}

}  // namespace palpate::web
