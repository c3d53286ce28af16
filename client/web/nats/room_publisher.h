// Publishes what the hub holds in a room of a NATS server: a sink beside the guests' browsers.
//
// Newest wins everywhere; while NATS is away nothing waits in memory, and everything is published
// anew when it is back. Two connections with a thread each, so that poses do not wait for voxels.
//
// Threads: those of Subscriber and the constructor on the network thread, which never waits here.
// The publisher must live until no posted function runs any more. Ownership: borrows the hub.
// Errors: the constructor throws kInvalidArgument (as Check, or no name of a room).
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "client/web/hub/hub.h"
#include "client/web/nats/kept_publisher.h"
#include "client/web/nats/live_publisher.h"
#include "client/web/nats/nats_options.h"
#include "client/web/nats/remote_steering.h"
#include "client/web/source/source.h"

namespace palpate::web {

class RoomPublisher final : public Subscriber {
 public:
  RoomPublisher(RoomOptions options, Hub& hub, Post post);
  ~RoomPublisher();
  RoomPublisher(const RoomPublisher&) = delete;
  RoomPublisher& operator=(const RoomPublisher&) = delete;

  void OnTopic(Topic topic) override;
  void OnPose() override;
  bool is_guest() const override { return false; }

  // Any thread.
  bool is_connected() const;
  // Why the room is not published; empty: it is.
  std::string problem() const;

 private:
  LivePublisher::Calls Calls();
  void TakeOther(LivePublisher::Other other);
  void TakeRequest(const std::string& site, const std::string& json, const std::string& reply);

  void LogProblem();

  const RoomOptions options_;
  Hub& hub_;
  const Post post_;
  RemoteSteering steering_;
  bool is_put_posted_ = false;
  std::string logged_ = "not yet";  // the last problem in the log; empty: none
  std::chrono::steady_clock::time_point logged_at_{};
  std::unique_ptr<KeptPublisher> kept_;
  std::unique_ptr<LivePublisher> live_;  // ends first: it tells kept_ of another publisher
};

}  // namespace palpate::web
