// What a room's guests are told of the way to its palpated: the gateway's link to NATS by which
// poses and beats come, then the room's publisher, then the publisher's own word; and of the
// volume.
//
// A publisher is heard by its beats, twice a second. Threads: pure. Time is passed in.
// Errors: none. What is no message of the room is ignored.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "client/sdk/connection.h"
#include "client/web/room/room_protocol.h"

namespace palpate::web {

class RoomState {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // `machine`: this one, as beats name theirs.
  RoomState(std::string machine, Time now) : machine_(std::move(machine)), since_(now) {}

  // May be called without a change.
  void TakeLink(bool is_connected, Time now);
  void TakeBeat(const Beat& beat, Time now);
  // The publisher's text of the topic `connection`, as RoomCopy gives it.
  void TakeText(std::string_view json);
  // The same of the topic `copy`.
  void TakeCopyText(std::string_view json);
  // The link by which voxels come.
  void TakeVolumeLink(bool is_connected) { has_volume_link_ = is_connected; }
  // A volume is shown.
  void TakeVolume() { has_volume_ = true; }

  struct Connection {
    client::ConnectionState state = client::ConnectionState::kConnecting;
    std::string why{};       // "": connected
    std::string palpated{};  // the last known name
  };
  Connection At(Time now) const;
  struct Volume {
    std::string problem{};    // why it does not follow; "": it does
    bool is_loading = false;  // `problem` says how far palpated's first volume is
  };
  Volume volume() const;
  // What of the volume is missing, for the log; "": nothing.
  std::string MissingVolume() const;
  // A publisher of this protocol is heard.
  bool is_published(Time now) const;
  // The newest beat's machine is this one.
  bool shares_clock() const { return shares_clock_; }

 private:
  const std::string machine_;
  Time since_;  // of the link's state
  bool is_connected_ = false, was_connected_ = false;
  std::optional<Time> heard_, heard_other_;  // a publisher of this protocol, of another one
  Time published_since_;                     // while is_published
  bool shares_clock_ = false;
  std::optional<Connection> word_;  // the publisher's own
  Volume volume_;                   // the publisher's own
  bool has_volume_link_ = false, has_volume_ = false;
};

}  // namespace palpate::web
