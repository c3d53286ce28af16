#include "client/web/room/beat.h"

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>

#include "client/web/logins/secret.h"

namespace palpate::web {
namespace {

constexpr std::uint64_t kMostProtocol = 1'000'000;

}  // namespace

std::string ToJson(const Beat& beat) {
  return nlohmann::ordered_json{{"protocol", beat.protocol},
                                {"session", beat.session},
                                {"machine", beat.machine},
                                {"kept", beat.kept}}
      .dump();
}

std::optional<Beat> ParseBeat(std::string_view json) {
  const auto read = nlohmann::json::parse(json, nullptr, false);
  try {
    const auto& protocol = read.at("protocol");
    if (!protocol.is_number_unsigned() || protocol.get<std::uint64_t>() > kMostProtocol) {
      return std::nullopt;
    }
    Beat beat{.protocol = protocol.get<int>()};
    beat.session = read.value("session", std::string());
    beat.machine = read.value("machine", std::string());
    if (beat.protocol == kRoomProtocol) beat.kept = read.value("kept", beat.kept);
    return beat;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

ContentHash KeptHash(std::string_view subject, std::string_view message) {
  const std::string bytes = std::string(subject) + '\0' + std::string(message);
  return HashOfBytes(std::byte{1}, std::as_bytes(std::span(bytes)));
}

std::string ThisMachine() {
  std::string boot;
  std::ifstream("/proc/sys/kernel/random/boot_id") >> boot;
  return ToHex(Sha256(boot)).substr(0, 32);
}

}  // namespace palpate::web
