// Tokens: secrets by which clients are recognised over TLS.
//
// A token is "palpate_" and 256 random bits in base64url. The daemon keeps a random
// salt and SHA-256(salt, token) of it. A fast hash is right here: a slow one makes
// guessing people's passwords expensive, and 256 random bits cannot be guessed.
//
// Threads: plain values; Find from any.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/security/role.h"

namespace palpate {

struct StoredToken {
  std::string name{};  // letters, digits and ._- ; at most 64
  Role role = Role::kViewer;
  std::string salt_hex{};    // 32 digits
  std::string sha256_hex{};  // 64 digits
  // It is nobody's from then on; absent: for ever.
  std::optional<std::chrono::sys_seconds> expires{};
};

struct NewToken {
  std::string text{};  // shown once, and kept nowhere
  StoredToken stored{};
};

// Errors: kInvalidArgument for a name that is none.
NewToken MakeToken(const std::string& name, Role role);
void CheckTokenName(const std::string& name);

// SHA-256(salt, token) in hex. The salt is hex.
std::string HashToken(std::string_view salt_hex, std::string_view token);

// Null: nobody's. Compares with all of them, each in constant time, so that the time
// of a refusal says nothing of how near a guess was.
const StoredToken* FindToken(const std::vector<StoredToken>& tokens, std::string_view token);

}  // namespace palpate
