// A subscriber of poses on a connection of its own, without a thread of its own: gRPC
// calls it back. It acknowledges, as the client library does.
//
// Threads: Begin, Stop and the results on the one that made it; the results after Stop.
#pragma once

#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "palpate/v1/pose.grpc.pb.h"

namespace palpate::load {

struct SubscriberKind {
  const char* name;
  double rate_hz;
  std::uint32_t batch;
  std::uint32_t max_unacknowledged;
};

// One sample as it came.
struct Received {
  std::uint64_t loop_ms;  // tick + missed ticks: milliseconds of the servo's loop
  std::uint64_t missed_ticks;
  std::int64_t time_ns;  // start of the tick, CLOCK_MONOTONIC
  std::int64_t update_ns;
  bool is_contact_fault;
};

class Subscriber final
    : public grpc::ClientBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse> {
 public:
  Subscriber(const std::string& target, const SubscriberKind& kind);
  ~Subscriber() override { Stop(); }

  // Ends the stream and waits for its end.
  void Stop();

  const SubscriberKind& kind() const { return kind_; }
  std::size_t received_so_far() const;
  // By the daemon, or by Stop.
  bool has_ended() const;
  // Time of the newest tick so far; 0: none.
  std::int64_t newest_ns() const;
  const std::vector<Received>& received() const { return received_; }
  // Of each message's newest sample on arrival; the daemon's clock is ours.
  const std::vector<std::int64_t>& ages_ns() const { return ages_ns_; }
  std::uint64_t dropped() const { return dropped_; }
  // Before Stop ended it.
  const std::string& error() const { return error_; }

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;

 private:
  void Take(const v1::StreamPosesResponse& message);
  void AcknowledgeIfPossible();

  const SubscriberKind kind_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::PoseService::Stub> stub_;
  grpc::ClientContext context_;
  v1::StreamPosesResponse message_;
  v1::StreamPosesRequest request_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable ended_;
  bool done_ = false;
  bool stopping_ = false;
  bool writing_ = true;
  std::uint64_t newest_ = 0;
  std::uint64_t acknowledged_ = 0;
  std::vector<Received> received_;
  std::vector<std::int64_t> ages_ns_;
  std::uint64_t dropped_ = 0;
  std::string error_;
};

}  // namespace palpate::load
