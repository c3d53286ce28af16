// The pose thread: connects, follows the poses, notices losses, and connects again.
//
// Threads: one of its own; call all methods from any. Ownership: borrows its arguments. Call
// Begin() once. Call End() before the arguments are destroyed.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "client/sdk/acknowledged_call.h"
#include "client/sdk/backoff.h"
#include "client/sdk/link.h"
#include "client/sdk/monitor.h"
#include "client/sdk/pose.h"
#include "palpate/v1/pose.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::client {

// Returns the batch to ask for. Errors: kInvalidArgument, as PoseRate says.
int BatchOf(const PoseRate& rate);

class PoseFollower {
 public:
  struct Events {
    std::function<void(const Connection&)> connection{};
    std::function<void(const PoseBatch&)> poses{};
    // The daemon's settings; called before `connection` reports kConnected.
    std::function<void(const v1::GetSettingsResponse&)> first_settings{};
  };

  // Errors: as BatchOf.
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

}  // namespace palpate::client
