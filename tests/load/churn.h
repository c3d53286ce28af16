// Clients that change settings and voxels at a steady rate.
//
// Threads: one each; results after Stop.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

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

}  // namespace palpate::load
