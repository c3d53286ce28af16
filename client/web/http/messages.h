// What browsers send over /stream: JSON of at most kMaxMessageBytes.
//
// Threads: any. Errors: none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

namespace palpate::web {

inline constexpr std::size_t kMaxMessageBytes = 1024;

struct Ack {
  std::uint32_t sequence = 0;  // of the newest pose that was received
};

struct Steer {
  std::uint64_t id = 0;  // comes back with the answer
  std::string key;
  double value = 0.0;
};

// Nothing: no message of the contract.
std::optional<std::variant<Ack, Steer>> ParseMessage(std::string_view text);

// The answer to a Steer. `error`: empty if it was carried out.
std::string SteeredJson(std::uint64_t id, const std::string& error);

// What POST /login brings: one of the two.
struct LoginRequest {
  std::optional<std::string> room, token;
};
std::optional<LoginRequest> ParseLogin(std::string_view text);

}  // namespace palpate::web
