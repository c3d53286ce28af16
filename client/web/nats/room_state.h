// What a room's guests are told of the way to its palpated: the gateway's link to NATS, then the
// room's publisher, then the publisher's own word.
//
// A publisher is heard by its beats, twice a second. Threads: pure. Time is passed in.
#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "client/sdk/connection.h"

namespace palpate::web {

class RoomState {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // A publisher that was not heard for so long is away.
  static constexpr std::chrono::seconds kSilence{3};

  // `machine`: this one's, as publishers name theirs.
  explicit RoomState(std::string machine) : machine_(std::move(machine)) {}

  void TakeLink(bool is_connected, Time now);  // whenever; no change is no news
  // Ignores what is no beat.
  void TakeBeat(std::string_view json, Time now);
  // The topic connection's text of the publisher. Ignores what is none.
  void TakeText(std::string_view json);

  struct Connection {
    client::ConnectionState state = client::ConnectionState::kConnecting;
    std::string why{};       // "": connected
    std::string palpated{};  // the last known name
    friend bool operator==(const Connection&, const Connection&) = default;
  };
  Connection At(Time now) const;
  // A publisher of this protocol is there.
  bool is_published(Time now) const;
  // The newest publisher's clock is this machine's.
  bool shares_clock() const { return shares_clock_; }

 private:
  const std::string machine_;
  bool is_connected_ = false;
  Time since_{};                  // of the link's state
  Time heard_{}, heard_other_{};  // a publisher of this protocol, of another one
  bool shares_clock_ = false;
  Connection publishers_{};  // own word
  bool has_text_ = false;
};

}  // namespace palpate::web
