// Publishes what the hub holds in a room of a NATS server: a sink beside the guests' browsers.
//
// Newest wins everywhere; while NATS is away nothing waits in memory, and everything is published
// anew when it is back. Two connections with a thread each, so that poses do not wait for voxels.
//
// Threads: those of Subscriber and the constructor on the network thread, which never waits here.
// The publisher must live until no posted function runs any more. Ownership: borrows the hub.
// Errors: the constructor throws kInvalidArgument (as Check, or no name of a room).
#pragma once

#include <array>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>

#include "client/web/hub/hub.h"
#include "client/web/room/kept_publisher.h"
#include "client/web/room/live_publisher.h"
#include "client/web/room/nats_options.h"
#include "client/web/room/remote_steering.h"
#include "client/web/upstream/source.h"

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

  // Once a second: logs whether the room is published, when that changes, and what is wrong with it
  // at most once a minute.
  void Poll();

  // Any thread.
  bool is_connected() const;
  // Why the room is not published; empty: it is.
  std::string problem() const;

 private:
  LivePublisher::Calls Calls();
  void TakeRequest(const std::string& site, const std::string& json, const std::string& reply);

  const RoomOptions options_;
  Hub& hub_;
  const Post post_;
  RemoteSteering steering_;
  bool is_put_posted_ = false;
  bool was_published_ = false;  // says the log
  std::string logged_;          // why not
  // When it said that it is not, and that it is.
  std::array<std::chrono::steady_clock::time_point, 2> logged_at_{};
  std::mutex mutex_;
  std::string refused_;  // what the server said; not in the log yet
  std::unique_ptr<KeptPublisher> kept_;
  std::unique_ptr<LivePublisher> live_;  // ends first: it uses kept_
};

}  // namespace palpate::web
