// The heartbeat of a room's publisher: says that it is there, and who it is. JSON:
//   {"protocol": 2, "session": 16 hex digits, random at each start, "machine": 32 hex digits,
//    "kept": {"settings": 32 hex digits, ..., "volume": ...}}
// kept: NameOf the KeptHash of the newest messages that this session has put; a topic's name, or
// "volume" for the volume's message. A receiver that has another one has missed it: a leaf server
// loses messages while its link is cut.
//
// Threads: pure; ThisMachine reads a file.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "common/bricks/brick.h"

namespace palpate::web {

inline constexpr int kRoomProtocol = 2;
inline constexpr std::chrono::milliseconds kBetweenBeats{500};
inline constexpr std::chrono::seconds kBeatLife{3};  // without a beat: the publisher is away

struct Beat {
  int protocol = kRoomProtocol;
  std::string session{};
  std::string machine{};
  std::map<std::string, std::string> kept{};
};

std::string ToJson(const Beat& beat);
// None: no beat. Of another protocol, the other members may be empty.
std::optional<Beat> ParseBeat(std::string_view json);

ContentHash KeptHash(std::string_view subject, std::string_view message);

// Equal where CLOCK_MONOTONIC is the same: a hash of this start of this machine.
std::string ThisMachine();

}  // namespace palpate::web
