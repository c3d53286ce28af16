// The threads of a Client: each follows one stream of palpated, as long as there is a
// connection.
//
// Threads: one of its own; call all methods from any. Ownership: borrows its arguments. Call
// Begin() once. Call End() before the arguments are destroyed.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "client/sdk/acknowledged_call.h"
#include "client/sdk/backoff.h"
#include "client/sdk/connection.h"
#include "client/sdk/facts.h"
#include "client/sdk/link.h"
#include "client/sdk/pose.h"
#include "client/sdk/volume_copy.h"
#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_reader.h"
#include "palpate/v1/facts.grpc.pb.h"
#include "palpate/v1/pose.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::client {

// The state of the connection. All threads of a client can read it and wait for it.
class Monitor {
 public:
  Connection connection() const {
    const std::lock_guard lock(mutex_);
    return connection_;
  }
  // How often the client has connected so far. Values from another epoch are void.
  std::uint64_t epoch() const {
    const std::lock_guard lock(mutex_);
    return epoch_;
  }
  bool IsConnected(std::uint64_t epoch) const {
    const std::lock_guard lock(mutex_);
    return epoch_ == epoch && IsUp();
  }
  bool stopping() const {
    const std::lock_guard lock(mutex_);
    return stopping_;
  }

  // Returns false if nothing changed.
  bool Set(Connection connection) {
    {
      const std::lock_guard lock(mutex_);
      if (connection.state == connection_.state && connection.why == connection_.why) return false;
      if (connection.state == ConnectionState::kConnected) ++epoch_;
      connection_ = std::move(connection);
    }
    changed_.notify_all();
    return true;
  }
  void Stop() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
  }

  // Waits until connected and returns the epoch; 0 after `timeout` or Stop.
  std::uint64_t WaitUntilConnected(std::chrono::milliseconds timeout) const {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, timeout, [this] { return stopping_ || IsUp(); });
    return !stopping_ && IsUp() ? epoch_ : 0;
  }
  // Sleeps for the duration, or until Stop.
  void Pause(std::chrono::milliseconds duration) const {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, duration, [this] { return stopping_; });
  }

 private:
  bool IsUp() const { return connection_.state == ConnectionState::kConnected; }

  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  Connection connection_;
  std::uint64_t epoch_ = 0;
  bool stopping_ = false;
};

// The facts thread: follows what the daemon tells, while there is a connection.
class FactsFollower {
 public:
  struct Events {
    std::function<void(const Settings&)> settings{};
    std::function<void(const Facts&)> facts{};
  };

  FactsFollower(Link& link, Monitor& monitor, Events events)
      : link_(link), monitor_(monitor), events_(std::move(events)) {}
  ~FactsFollower() { End(); }

  void Begin();
  // Joins the thread. Call it after Monitor::Stop and Link::CancelCalls.
  void End();

  // Never null.
  std::shared_ptr<const Facts> Newest() const;
  std::optional<Settings> NewestSettings() const;
  // Sets the settings of a new connection. Those of the connection before are void.
  void Replace(const Settings& settings);
  // Takes the settings that a call brought in `epoch`, unless newer ones are known.
  void Take(const Settings& settings, std::uint64_t epoch);

 private:
  void Run();
  void Follow(std::uint64_t epoch);
  static void Merge(const v1::Facts& message, Facts& facts);
  void Put(const Facts& facts, std::uint64_t epoch);

  Link& link_;
  Monitor& monitor_;
  const Events events_;

  mutable std::mutex mutex_;
  std::shared_ptr<const Facts> newest_ = std::make_shared<const Facts>();
  std::optional<Settings> settings_;

  std::thread thread_;
};

// The pose thread: connects, follows the poses, notices losses, and connects again.
class PoseFollower {
 public:
  struct Events {
    std::function<void(const Connection&)> connection{};
    std::function<void(const PoseBatch&)> poses{};
    // The daemon's settings; called before `connection` reports kConnected.
    std::function<void(const v1::GetSettingsResponse&)> first_settings{};
  };

  // Errors: kInvalidArgument, as PoseRate says.
  PoseFollower(Link& link, Monitor& monitor, const PoseRate& rate, Events events);
  ~PoseFollower() { End(); }

  void Begin();
  // Joins the thread. Call it after Monitor::Stop and Link::CancelCalls.
  void End();

  std::optional<Pose> Newest() const;
  std::uint64_t dropped() const { return dropped_; }
  void SetRate(const PoseRate& rate);

 private:
  using Call = AcknowledgedCall<v1::StreamPosesRequest, v1::StreamPosesResponse>;

  void Run();
  // Returns when the follower is stopped. Throws an Error when the connection is lost.
  void Follow();
  v1::GetSettingsResponse AskForSettings();
  void Read(Call& call, int rate_number);
  // Takes the message and all messages that piled up behind it.
  void TakeAll(Call& call, v1::StreamPosesResponse& message);
  void Add(const v1::StreamPosesResponse& message, PoseBatch& batch) const;
  void Report(const Connection& connection);

  Link& link_;
  Monitor& monitor_;
  const Events events_;
  Backoff backoff_;

  // Used by the pose thread only.
  std::uint64_t dropped_before_ = 0;                   // by ended streams
  bool is_slow_ = false;                               // the last callback took at least kSlow
  std::chrono::steady_clock::time_point kept_stop_{};  // the last Link::KeepStopReady

  mutable std::mutex mutex_;
  std::optional<Pose> newest_;
  PoseRate rate_;
  std::atomic<int> rate_number_{0};  // rises with every SetRate
  std::atomic<std::uint64_t> dropped_{0};

  std::thread thread_;
};

// The volume thread: keeps a copy of the volume while palpated is reached.
class VolumeFollower {
 public:
  VolumeFollower(Link& link, Monitor& monitor, std::function<void()> on_volume);
  ~VolumeFollower() { End(); }

  void Begin();
  // Joins the thread. Call it after Monitor::Stop.
  void End();

  std::optional<VolumeUpdate> Take() { return copy_.Take(); }
  VolumeStatus status() const;

 private:
  void Run();
  void Follow(std::uint64_t epoch);
  void Say(const VolumeReader* reader, const std::string& problem);

  Link& link_;
  Monitor& monitor_;
  const std::function<void()> on_volume_;
  VolumeMirror mirror_;             // used by the volume thread only
  std::uint64_t bytes_before_ = 0;  // by ended readers
  VolumeCopy copy_;

  mutable std::mutex mutex_;
  VolumeStatus status_;

  std::thread thread_;
};

}  // namespace palpate::client
