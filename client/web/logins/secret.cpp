#include "client/web/logins/secret.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/rand.h>

#include <cstddef>
#include <span>

#include "common/error/error.h"

namespace palpate::web {
namespace {

std::string HexOf(std::span<const std::uint8_t> bytes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string hex;
  for (const std::uint8_t byte : bytes) {
    hex += kDigits[byte >> 4];
    hex += kDigits[byte & 15];
  }
  return hex;
}

int ValueOf(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'a' && digit <= 'f') return digit - 'a' + 10;
  if (digit >= 'A' && digit <= 'F') return digit - 'A' + 10;
  return -1;
}

}  // namespace

Digest Sha256(std::string_view text) {
  Digest digest{};
  if (EVP_Digest(text.data(), text.size(), digest.data(), nullptr, EVP_sha256(), nullptr) != 1) {
    throw Error(ErrorKind::kInternal, "SHA-256 failed");
  }
  return digest;
}

std::string ToHex(const Digest& digest) { return HexOf(digest); }

std::optional<Digest> DigestFromHex(std::string_view hex) {
  Digest digest{};
  if (hex.size() != 2 * digest.size()) return std::nullopt;
  for (std::size_t n = 0; n < digest.size(); ++n) {
    const int high = ValueOf(hex[2 * n]);
    const int low = ValueOf(hex[2 * n + 1]);
    if (high < 0 || low < 0) return std::nullopt;
    digest[n] = static_cast<std::uint8_t>(16 * high + low);
  }
  return digest;
}

bool IsEqual(const Digest& a, const Digest& b) {
  return CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

std::string NewSecret(int bits) {
  Digest bytes{};
  const auto count = static_cast<std::size_t>(bits / 8);
  if (count > bytes.size() || RAND_bytes(bytes.data(), static_cast<int>(count)) != 1) {
    throw Error(ErrorKind::kInternal, "the system gave no random bytes: try again");
  }
  return HexOf(std::span(bytes).first(count));
}

}  // namespace palpate::web
