#include "server/security/token.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/rand.h>

#include <algorithm>
#include <array>
#include <cctype>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr std::string_view kPrefix = "palpate_";
constexpr std::size_t kSecretBytes = 32;
constexpr std::size_t kSaltBytes = 16;
constexpr std::size_t kMostTokenLength = 128;

template <std::size_t kSize>
std::array<unsigned char, kSize> RandomBytes() {
  std::array<unsigned char, kSize> bytes{};
  if (RAND_bytes(bytes.data(), static_cast<int>(kSize)) != 1) {
    throw Error(ErrorKind::kInternal, "the system gave no random bytes: try again");
  }
  return bytes;
}

template <class Bytes>
std::string Hex(const Bytes& bytes) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

// Leaves out the padding, which carries no data.
template <class Bytes>
std::string Base64Url(const Bytes& bytes) {
  std::string text(4 * (bytes.size() / 3 + 1) + 1, '\0');
  const int length = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()), bytes.data(),
                                     static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  std::replace(text.begin(), text.end(), '+', '-');
  std::replace(text.begin(), text.end(), '/', '_');
  text.resize(std::min(text.size(), text.find('=')));
  return text;
}

}  // namespace

void CheckTokenName(const std::string& name) {
  const auto is_plain = [](unsigned char c) {
    return c < 128 && (std::isalnum(c) || c == '.' || c == '_' || c == '-');
  };
  if (name.empty() || name.size() > 64 || !std::all_of(name.begin(), name.end(), is_plain)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the name of a token has 1 to 64 letters, digits and ._- only");
  }
}

NewToken MakeToken(const std::string& name, Role role) {
  CheckTokenName(name);
  NewToken token;
  token.text = std::string(kPrefix) + Base64Url(RandomBytes<kSecretBytes>());
  token.stored = {name, role, Hex(RandomBytes<kSaltBytes>()), {}};
  token.stored.sha256_hex = HashToken(token.stored.salt_hex, token.text);
  return token;
}

std::string HashToken(std::string_view salt_hex, std::string_view token) {
  std::string text(salt_hex);
  text += token;
  std::array<unsigned char, 32> digest{};
  if (EVP_Digest(text.data(), text.size(), digest.data(), nullptr, EVP_sha256(), nullptr) != 1) {
    throw Error(ErrorKind::kInternal, "SHA-256 failed");
  }
  OPENSSL_cleanse(text.data(), text.size());
  return Hex(digest);
}

const StoredToken* FindToken(const std::vector<StoredToken>& tokens, std::string_view token) {
  // A client may send any amount of data. Only text that may be a token is hashed.
  if (!token.starts_with(kPrefix) || token.size() > kMostTokenLength) return nullptr;
  const StoredToken* found = nullptr;
  for (const StoredToken& stored : tokens) {
    const std::string hash = HashToken(stored.salt_hex, token);
    if (hash.size() == stored.sha256_hex.size() &&
        CRYPTO_memcmp(hash.data(), stored.sha256_hex.data(), hash.size()) == 0) {
      found = &stored;
    }
  }
  return found;
}

}  // namespace palpate
