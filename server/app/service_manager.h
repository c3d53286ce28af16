// Tells systemd that the daemon is ready, what the daemon does, and that the servo is alive. See
// sd_notify(3) and sd_watchdog_enabled(3).
//
// Does nothing if systemd did not start the daemon (no $NOTIFY_SOCKET). Threads: main. Errors:
// none. If a message is lost, systemd acts on its own time limits. Apart for its tests.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace palpate {

class ServiceManager {
 public:
  void Ready();
  // Between Reloading() and Reloaded() the daemon reads the configuration again.
  void Reloading();
  void Reloaded() { Ready(); }
  void Stopping();
  // Sends one line for `systemctl status`, if it differs from the last line.
  void Status(const std::string& line);
  void FeedWatchdog();

  // The longest time between two feeds of the watchdog ($WATCHDOG_USEC). None: no watchdog.
  static std::optional<std::chrono::microseconds> WatchdogInterval();

 private:
  std::string status_;
};

// True if a servo with this number of ticks in `time` runs: it makes at least half of its ticks.
// With fewer ticks the servo is stuck or starved, and the stylus does not feel the volume.
bool ServoRan(std::uint64_t ticks, std::chrono::nanoseconds time);

// Feeds the watchdog as long as the servo runs. The servo ticks in every state of the forces, also
// while nothing is felt. A servo that does not tick is stuck.
class ServoWatchdog {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // Call IsDue at this period. If two calls are more than two periods apart, the whole machine
  // stood still, and the servo with it. That time does not count.
  static constexpr std::chrono::milliseconds kLookPeriod{100};

  // Feeds four times in each interval, so that one late feed does not end the daemon. Without an
  // interval there is no watchdog.
  explicit ServoWatchdog(std::optional<std::chrono::microseconds> interval);

  // Returns true if the watchdog must be fed now: a quarter of the interval is over, and the servo
  // ran in it. `ticks`: the number of the servo's ticks since its start.
  bool IsDue(std::uint64_t ticks, Time now);

 private:
  std::optional<std::chrono::microseconds> period_;
  Time looked_{};
  // The start of the present quarter of the interval.
  Time began_{};
  std::uint64_t ticks_at_begin_ = 0;
  std::chrono::nanoseconds judged_{};  // counted time in this quarter
};

}  // namespace palpate
