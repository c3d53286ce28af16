// Clients that load a daemon: that change settings and voxels at a steady rate, on a thread each;
// and subscribers of poses on connections of their own, without threads: gRPC calls them back. They
// acknowledge, as the client library does.
//
// Threads: begin, Stop and the results on the one that made it; the results after Stop.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "palpate/v1/pose.grpc.pb.h"

namespace palpate::load {

class SteadyCaller {
 public:
  // call(n): the n-th call, which blocks until it is answered.
  SteadyCaller(double rate_hz, std::function<grpc::Status(std::uint64_t n)> call);
  ~SteadyCaller() { Stop(); }

  void Stop();
  double rate_hz() const { return rate_hz_; }
  std::uint64_t calls() const { return calls_; }
  const std::string& error() const { return error_; }  // of the last call that failed

 private:
  void Run();

  const double rate_hz_;
  const std::function<grpc::Status(std::uint64_t)> call_;
  std::atomic<bool> stop_{false};
  std::uint64_t calls_ = 0;
  std::string error_;
  std::thread thread_;
};

// Stiffness and isovalue in turn, small steps around the middle.
std::function<grpc::Status(std::uint64_t)> SettingsCalls(const std::string& target);
// Spheres of 11 voxels across, anywhere in a volume of edge³ voxels.
std::function<grpc::Status(std::uint64_t)> EditCalls(const std::string& target, int edge,
                                                     unsigned seed);

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
  std::string error_;
};

}  // namespace palpate::load
