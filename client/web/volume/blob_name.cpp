#include "client/web/volume/blob_name.h"

#include <cstdint>

#include "common/error/error.h"

namespace palpate::web {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";
constexpr std::string_view kBase64Digits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

constexpr std::uint8_t kNoDigit = 64;

constexpr std::array<std::uint8_t, 256> Base64Values() {
  std::array<std::uint8_t, 256> values{};
  for (std::uint8_t& value : values) value = kNoDigit;
  for (std::size_t n = 0; n < kBase64Digits.size(); ++n) {
    values.at(static_cast<std::uint8_t>(kBase64Digits[n])) = static_cast<std::uint8_t>(n);
  }
  return values;
}

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

ContentHash HashOf(std::string_view bytes) {
  ContentHash hash;
  for (std::size_t n = 0; n < 16; ++n) {
    std::uint64_t& half = n < 8 ? hash.high : hash.low;
    half = half << 8 | static_cast<std::uint8_t>(bytes.at(n));
  }
  return hash;
}

std::string Base64(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t n = 0; n < bytes.size(); n += 3) {
    std::uint32_t three = 0;
    for (std::size_t m = n; m < n + 3; ++m) {
      three = three << 8 | (m < bytes.size() ? static_cast<std::uint8_t>(bytes[m]) : 0);
    }
    for (std::size_t m = 0; m < 4; ++m) {
      text += n + m <= bytes.size() ? kBase64Digits[three >> (18 - 6 * m) & 63] : '=';
    }
  }
  return text;
}

std::string FromBase64(std::string_view text) {
  static constexpr auto kValues = Base64Values();
  if (text.size() % 4 != 0) Refuse("no base64");
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with('=') ? 1 : 0;
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  for (std::size_t n = 0; n < text.size(); n += 4) {
    std::uint32_t three = 0;
    for (std::size_t m = n; m < n + 4; ++m) {
      const bool is_padding = m >= text.size() - padding;
      const std::uint8_t value = is_padding ? 0 : kValues.at(static_cast<std::uint8_t>(text[m]));
      if (value == kNoDigit) Refuse("no base64");
      three = three << 6 | value;
    }
    for (int shift = 16; shift >= 0; shift -= 8) bytes += static_cast<char>(three >> shift & 255);
  }
  bytes.resize(bytes.size() - padding);
  return bytes;
}

}  // namespace palpate::web
