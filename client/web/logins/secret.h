// Random secrets and their hashes. Only hashes are kept, and only hashes are compared.
//
// SHA-256 without salt is enough for tokens and sessions: nobody can guess 128 random bits.
//
// Threads: any. Errors: kInternal if the system gives no random bytes.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace palpate::web {

using Digest = std::array<std::uint8_t, 32>;

Digest Sha256(std::string_view text);
// 64 lower-case hex digits.
std::string ToHex(const Digest& digest);
// Nothing unless `hex` is 64 hex digits.
std::optional<Digest> DigestFromHex(std::string_view hex);

// Takes the same time wherever the digests differ.
bool IsEqual(const Digest& a, const Digest& b);

// `bits` random bits as lower-case hex digits. `bits`: a multiple of 8, at most 256.
std::string NewSecret(int bits);

}  // namespace palpate::web
