// Where what guests see comes from: palpated, or a room of a NATS server. A source puts everything
// new into the hub, which does not know which source it is.
//
// After a loss everything comes back by itself; the hub keeps the last state meanwhile.
//
// Threads: methods on the network thread, unless stated. Errors: none.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/web/hub/hub.h"

namespace palpate::web {

// The clocks of messages, for any thread: of the Unix epoch [ms].
inline std::int64_t NowMs() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

// Of this start of the machine [ns].
inline std::int64_t MonotonicNs() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::nanoseconds(now).count();
}

// Runs a function on the network thread.
using Post = std::function<void(std::function<void()>)>;

struct SourceOptions {
  std::string version;
  // On the network thread; one line each.
  std::function<void(const std::string& line)> log;
  std::function<void(bool is_accepted)> steered;
};

class Source {
 public:
  explicit Source(SourceOptions options) : common_(std::move(options)) {}
  virtual ~Source() = default;

  // Asks for what is not told by itself. Call it once a second.
  virtual void Poll() {}

  // What the hub needs; see its members of the same names. FindBlob: any thread.
  virtual BlobPtr FindBlob(std::string_view name) const = 0;
  virtual void Steer(const SteerRequest& request, std::function<void(std::string error)> done) = 0;
  virtual std::string Health() const = 0;
  // Whether the emergency stop can reach palpated from here.
  virtual bool MayStop() const { return true; }
  std::string Hello(const std::string& user, const std::vector<std::string>& may_steer) const;

  // For metrics. Any thread.
  // Age of the newest pose [s]; none before the first. Of another machine: since it came.
  std::optional<double> pose_age_s() const;
  virtual bool is_copy_complete() const = 0;

 protected:
  // When the newest pose was, by MonotonicNs. Any thread.
  void SetPoseTime(std::int64_t time_ns) { pose_time_ns_ = time_ns; }
  // `error`: why the change was refused; empty: it was not. Returns false for a stop within a
  // second after one that was told: it is not told.
  bool TellSteered(const SteerRequest& request, const std::string& error);

 private:
  const SourceOptions common_;
  std::int64_t stop_told_ms_ = 0;
  std::atomic<std::int64_t> pose_time_ns_{0};
};

}  // namespace palpate::web
