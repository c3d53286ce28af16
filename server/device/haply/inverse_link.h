// A connection to Haply's service on this machine: its WebSocket, its events, and what it answers
// to HTTP. The only file that includes Boost.Beast is inverse_link.cpp.
//
// The service listens on this machine only, and asks for no password. It is not looked for
// elsewhere.
// Threads: one, such as the I/O thread. Ownership: the destructor closes the connection.
// Errors: BusError.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "server/device/stream/bus_error.h"

namespace palpate {

class InverseLink {
 public:
  static constexpr std::size_t kMostBytes = 64 * 1024;  // of a message
  static constexpr std::size_t kMostMessages = 8;       // that nobody has taken yet

  // Connects; gives up at `longest`, or soon after `stop` becomes true.
  InverseLink(std::uint16_t port, std::chrono::milliseconds longest, const std::atomic<bool>& stop);
  ~InverseLink();
  InverseLink(const InverseLink&) = delete;
  InverseLink& operator=(const InverseLink&) = delete;

  // Also listens to the service's events. Returns false if nobody answers there. If they end later,
  // Wait throws.
  bool ListenToEvents(std::uint16_t port, std::chrono::milliseconds longest,
                      const std::atomic<bool>& stop);

  // Waits until a message, an event or `longest`. Throws what ended the connection.
  void Wait(std::chrono::microseconds longest);
  struct Message {
    std::string text{};
    std::int64_t time_ns = 0;  // when it came, by MonotonicNowNs
  };
  // Of what Wait found, the oldest not taken yet. A message that is no text is an empty one.
  std::optional<Message> TakeMessage();
  std::optional<std::string> TakeEvent();
  // Sends a text. Returns false if the last one is still under way.
  bool TrySend(std::string_view text);
  // Ends the connection in order, within `longest`.
  void Close(std::chrono::milliseconds longest) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// What the service answers to GET.
struct InverseAnswer {
  int status = 0;  // 200, 404, ...; 0: there was no answer in time
  std::string body{};
};
InverseAnswer GetFromInverse(std::uint16_t port, const std::string& path,
                             std::chrono::milliseconds longest, const std::atomic<bool>& stop);

}  // namespace palpate
