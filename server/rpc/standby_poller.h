// A thread that reads from connections when none of gRPC's own does.
//
// In a server with callback methods, gRPC 1.51 reads from connections on the threads of its
// callback queue alone. Each of them sleeps for 100 ms after every second without a call of a
// callback method. Without this poller all of them may sleep at once, and every other call then
// waits for up to 100 ms.
//
// Threads: construct, Start and destroy on one thread.
// Errors: none.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <thread>

namespace palpate {

class StandbyPoller {
 public:
  // Before the builder builds the server.
  explicit StandbyPoller(grpc::ServerBuilder& builder) : queue_(builder.AddCompletionQueue()) {}
  // After the server was shut down.
  ~StandbyPoller();
  StandbyPoller(const StandbyPoller&) = delete;
  StandbyPoller& operator=(const StandbyPoller&) = delete;

  // Once, when the server runs.
  void Start();

 private:
  // No event ever comes to it.
  void Drain();

  std::unique_ptr<grpc::ServerCompletionQueue> queue_;
  std::thread thread_;
};

}  // namespace palpate
