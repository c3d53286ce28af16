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
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/room/kept_publisher.h"
#include "client/web/room/nats_link.h"
#include "client/web/room/remote_steering.h"
#include "client/web/room/room_protocol.h"
#include "client/web/upstream/source.h"

namespace palpate::web {

// What a room hears at once and nobody keeps: poses, the publisher's heartbeat, and answers to
// requests to steer. Also hears whether another gateway publishes the room.
//
// A publisher listens for a second before it sends, and sends nothing while another one does: until
// no beat came for kBeatLife. Of two that begin together, the one with the greater session waits.
//
// Threads: a thread of its own sends; methods on any, which never wait for NATS. `calls` are called
// on threads of the link and of the publisher.
// Errors: the constructor throws kInvalidArgument as Check does.
class LivePublisher {
 public:
  struct Calls {
    // Whether this one is silent, because another publishes the room, or may: at first it is.
    std::function<void(bool waits)> waits{};
    std::function<std::map<std::string, std::string>()> kept{};  // for Beat::kept
    std::function<void(const std::string& why)> refused{};       // by the server: a message
    // `user`: of NATS. Answer by Reply.
    std::function<void(std::string user, std::string json, std::string reply)> steer{};
  };

  LivePublisher(const NatsServer& server, const Subjects& subjects, Calls calls);
  ~LivePublisher();
  LivePublisher(const LivePublisher&) = delete;
  LivePublisher& operator=(const LivePublisher&) = delete;

  void PutPose(std::shared_ptr<const std::string> pose);
  // Each request that `steer` was called for takes one.
  void Reply(std::string subject, std::string json);

  bool is_connected() const { return link_.is_connected(); }
  // Why nothing is sent; empty: it is.
  std::string problem() const;

  static constexpr int kMostRequests = 64;  // that wait for a reply; the next ones are refused

 private:
  using Time = std::chrono::steady_clock::time_point;
  void Run();
  void TakeBeat(const NatsMessage& message);
  void TakeRequest(const NatsMessage& message);
  void SetWhy(const std::string& why);
  bool Waits(Time now) const;

  const Subjects subjects_;
  const Calls calls_;
  const Beat beat_;
  NatsLink link_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  std::shared_ptr<const std::string> pose_;  // not sent yet
  std::vector<std::pair<std::string, std::string>> replies_;
  int requests_ = 0;
  std::string why_ = "NATS is not reached";
  std::string other_session_;
  Time other_beat_{};
  Time beat_at_{};  // the last one sent
  bool waits_ = true;
  Time listens_until_ = Time::max();  // others' beats may be on their way
  std::thread thread_;
};

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
