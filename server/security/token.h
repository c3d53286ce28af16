// Tokens: secrets by which clients are recognised over TLS.
//
// A token is "palpate_" and 256 random bits in base64url. The daemon keeps a random salt and
// SHA-256(salt, token). A fast hash is enough: slow hashes protect passwords that can be guessed,
// and nobody can guess 256 random bits.
//
// Threads: plain values; Find from any.
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/security/methods.h"

namespace palpate {

struct StoredToken {
  std::string name{};  // letters, digits and ._- ; at most 64
  Role role = Role::kViewer;
  std::string salt_hex{};    // 32 digits
  std::string sha256_hex{};  // 64 digits
  // The token is refused from this time on; absent: it never expires.
  std::optional<std::chrono::sys_seconds> expires{};
};

struct NewToken {
  std::string text{};  // shown once; never stored
  StoredToken stored{};
};

// Throws kInvalidArgument for an invalid name.
NewToken MakeToken(const std::string& name, Role role);
void CheckTokenName(const std::string& name);

// SHA-256(salt, token) in hex. The salt is hex.
std::string HashToken(std::string_view salt_hex, std::string_view token);

// Returns null if the token is unknown. Compares with all tokens, each in constant time, so that
// the time of a refusal does not tell how close a guess was.
const StoredToken* FindToken(const std::vector<StoredToken>& tokens, std::string_view token);

// Reads and writes the file of tokens: TOML, one [[token]] per token.
//
// Errors: Error that names the file.

// Throws if other users than root and this process's user could have written the file: a user who
// writes it could become admin.
std::vector<StoredToken> ReadTokenFile(const std::filesystem::path& path);

// Writes the complete file or leaves it unchanged. A new file gets the mode 0640 and its folder's
// group, so that a daemon of this group can read a file that root writes. An existing file keeps
// its owner and mode.
void WriteTokenFile(const std::filesystem::path& path, const std::vector<StoredToken>& tokens);

// Such as "2027-01-31T12:00:00Z".
std::string ToText(std::chrono::sys_seconds time);

}  // namespace palpate
