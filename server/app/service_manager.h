// What systemd is told of the daemon, where it started it: that it is ready, what it
// does, and that the servo is alive. See sd_notify(3) and sd_watchdog_enabled(3).
//
// Without systemd ($NOTIFY_SOCKET) nothing happens. Threads: main. Errors: none; what
// systemd does not hear it finds out by its own time limits.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace palpate {

class ServiceManager {
 public:
  void Loading(const std::string& source);
  void Ready();
  // Between the two the configuration is read again.
  void Reloading();
  void Reloaded() { Ready(); }
  void Stopping();
  // One line for `systemctl status`; told when it is another than before.
  void Status(const std::string& line);
  void FeedWatchdog();

  // Within which the watchdog wants to be fed ($WATCHDOG_USEC); none: there is none.
  static std::optional<std::chrono::microseconds> WatchdogInterval();

 private:
  std::string status_;
};

// Whether a servo with so many ticks in that time runs: it makes at least half of them.
// With less it is stuck or starved, and nobody feels what the volume says.
bool ServoRan(std::uint64_t ticks, std::chrono::nanoseconds time);

// Feeds the watchdog for as long as the servo runs. In every state of the forces, and
// while nothing is felt, the servo ticks: one that does not is stuck.
class ServoWatchdog {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // How often it wants to be asked. Between two looks that are twice as far apart the
  // machine stood still, and the servo with it: that time is not judged.
  static constexpr std::chrono::milliseconds kLookPeriod{100};

  // Four feeds for each interval, so that a late one does not end the daemon. None:
  // there is no watchdog.
  explicit ServoWatchdog(std::optional<std::chrono::microseconds> interval);

  // Looks, and says whether to feed it now: a quarter of the interval is over, and the
  // servo ran in it. `ticks`: of the servo since its start.
  bool IsDue(std::uint64_t ticks, Time now);

 private:
  std::optional<std::chrono::microseconds> period_;
  Time looked_{};
  // The quarter of the interval that is judged next.
  Time began_{};
  std::uint64_t ticks_at_begin_ = 0;
  std::chrono::nanoseconds judged_{};  // without what was left out
};

}  // namespace palpate
