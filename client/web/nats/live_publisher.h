// What a room hears at once and nobody keeps: poses, the publisher's heartbeat, and answers to
// requests to steer. Also hears whether another gateway publishes the room.
//
// Of two publishers of a room, the one with the greater session number waits: it sends nothing
// until no beat of the other came for kBeatLife.
//
// Threads: a thread of its own sends; methods on any, which never wait for NATS. `calls` are called
// on threads of the link and of the publisher.
// Errors: the constructor throws kInvalidArgument as Check does.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "client/web/nats/beat.h"
#include "client/web/nats/nats_link.h"
#include "client/web/nats/subjects.h"

namespace palpate::web {

class LivePublisher {
 public:
  enum class Other { kNone, kWaits, kPublishes };  // the other publisher
  struct Calls {
    std::function<void(Other)> other_changed{};
    std::function<void()> problem_changed{};
    // `user`: of NATS. Answer by Reply.
    std::function<void(std::string user, std::string json, std::string reply)> steer{};
  };

  LivePublisher(const NatsServer& server, const Subjects& subjects, Calls calls);
  ~LivePublisher();
  LivePublisher(const LivePublisher&) = delete;
  LivePublisher& operator=(const LivePublisher&) = delete;

  void PutPose(std::shared_ptr<const std::string> pose);
  // See Beat::kept.
  void SetKept(std::map<std::string, std::string> kept);
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
  Other Look(Time now);

  const Subjects subjects_;
  const Calls calls_;
  Beat beat_;  // kept: guarded by mutex_
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
  Other other_ = Other::kNone;
  std::thread thread_;
};

}  // namespace palpate::web
