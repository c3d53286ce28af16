// What a device has to say to people: its problem of the moment, who it says it is, and
// lines for the log, one per change.
//
// The log is short: where nobody reads it, the oldest lines are lost.
//
// Threads: any; a lock that the servo never takes. Real-time: none.
#pragma once

#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <string>

#include "server/device/haptic_device.h"

namespace palpate {

class DeviceLog {
 public:
  static constexpr std::size_t kMaxEvents = 64;

  // name: what every line begins with.
  explicit DeviceLog(std::string name);

  // What is wrong now and what to do; a line, unless it was wrong before. "": nothing.
  void SetProblem(const std::string& problem);
  void SetConnected(const std::string& port, const std::string& identity);
  void Add(DeviceEvent::Level level, const std::string& text);

  std::optional<DeviceEvent> Next();
  // Its identity and problem.
  void FillIn(DeviceHealth& health) const;

 private:
  void Push(DeviceEvent::Level level, std::string text);

  const std::string name_;
  mutable std::mutex mutex_;
  std::deque<DeviceEvent> events_;
  std::string problem_;
  std::string identity_;
};

}  // namespace palpate
