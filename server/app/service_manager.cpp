#include "server/app/service_manager.h"

#include <systemd/sd-daemon.h>

#include <utility>

#include "server/realtime/tick_timer.h"
#include "server/servo/servo_loop.h"

namespace palpate {

void ServiceManager::Ready() { sd_notify(0, "READY=1"); }

void ServiceManager::Reloading() {
  // From the time, systemd knows which of several reloads is meant.
  sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%lld",
             static_cast<long long>(MonotonicNowNs() / 1000));
}

void ServiceManager::Stopping() { sd_notify(0, "STOPPING=1"); }

void ServiceManager::Status(const std::string& line) {
  if (line == status_) return;
  status_ = line;
  // File names may hold any character. A line break would begin another variable.
  std::string text = "STATUS=" + line;
  for (char& c : text) c = c == '\n' ? ' ' : c;
  sd_notify(0, text.c_str());
}

void ServiceManager::FeedWatchdog() { sd_notify(0, "WATCHDOG=1"); }

std::optional<std::chrono::microseconds> ServiceManager::WatchdogInterval() {
  std::uint64_t interval_us = 0;
  if (sd_watchdog_enabled(0, &interval_us) <= 0) return std::nullopt;
  return std::chrono::microseconds(interval_us);
}

bool ServoRan(std::uint64_t ticks, std::chrono::nanoseconds time) {
  constexpr double kLeastShare = 0.5;
  const double time_s = std::chrono::duration<double>(time).count();
  return ticks > 0 && static_cast<double>(ticks) >= kLeastShare * time_s * ServoLoop::kRateHz;
}

ServoWatchdog::ServoWatchdog(std::optional<std::chrono::microseconds> interval) {
  if (interval) period_ = *interval / 4;
}

bool ServoWatchdog::IsDue(std::uint64_t ticks, Time now) {
  if (!period_) return false;
  const Time before = std::exchange(looked_, now);
  if (now - before < 2 * kLookPeriod) judged_ += now - before;
  if (now - began_ < *period_) return false;
  const bool ran = ServoRan(ticks - ticks_at_begin_, judged_);
  began_ = now;
  ticks_at_begin_ = ticks;
  judged_ = {};
  return ran;
}

}  // namespace palpate
