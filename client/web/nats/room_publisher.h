// Publishes what the hub holds in a room of a NATS server: a sink beside the guests' browsers.
//
// Newest wins everywhere; while NATS is away nothing waits in memory, and everything is published
// anew when it is back. Two connections with a thread each, so that poses do not wait for voxels.
//
// Threads: those of Subscriber and the constructor on the network thread, which never waits here.
// The publisher must live until no posted function runs any more. Ownership: borrows the hub.
// Errors: the constructor throws kInvalidArgument (Check, no room's name).
#pragma once

#include <map>
#include <memory>
#include <string>

#include "client/web/access/steering_rules.h"
#include "client/web/hub/hub.h"
#include "client/web/nats/nats_options.h"
#include "client/web/source/source.h"

namespace palpate::web {

class KeptPublisher;
class LivePublisher;

class RoomPublisher final : public Subscriber {
 public:
  RoomPublisher(RoomOptions options, Hub& hub, Post post);
  ~RoomPublisher();
  RoomPublisher(const RoomPublisher&) = delete;
  RoomPublisher& operator=(const RoomPublisher&) = delete;

  void OnTopic(Topic topic) override;
  void OnPose() override;

  // Any thread.
  bool is_connected() const;
  // Why the room is not published; empty: it is.
  std::string problem() const;
};

}  // namespace palpate::web
