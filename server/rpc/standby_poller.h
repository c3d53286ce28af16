// A thread that reads from connections when none of gRPC's own threads does.
//
// In a server with callback methods, gRPC 1.51 reads from connections only on the threads of its
// callback queue. Each of these threads sleeps for 100 ms after every second without a call of a
// callback method. Without this poller, all of them may sleep at once, and every other call then
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
  // Construct it before the builder builds the server.
  explicit StandbyPoller(grpc::ServerBuilder& builder) : queue_(builder.AddCompletionQueue()) {}
  // Destroy it after the server was shut down.
  ~StandbyPoller();
  StandbyPoller(const StandbyPoller&) = delete;
  StandbyPoller& operator=(const StandbyPoller&) = delete;

  // Call it once, when the server runs.
  void Start();

 private:
  // Waits on the queue until its shutdown; the queue gets no events.
  void Drain();

  std::unique_ptr<grpc::ServerCompletionQueue> queue_;
  std::thread thread_;
};

}  // namespace palpate
