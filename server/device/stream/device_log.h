// Holds a device's reports for people: its present problem, its identity, and lines for the log,
// one per change.
//
// The log is short. If it is not read, the oldest lines are lost.
//
// Threads: any, with a lock that the servo never takes. Not real-time.
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

  // name: the start of every line.
  explicit DeviceLog(std::string name);

  // Sets the present problem and what to do; "": none. Adds a log line if the problem is new.
  void SetProblem(const std::string& problem,
                  DeviceEvent::Level level = DeviceEvent::Level::kWarning);
  // place: such as "USB port 1-2"; "": it has none.
  void SetConnected(const std::string& place, const std::string& identity);
  void Add(DeviceEvent::Level level, const std::string& text);

  std::optional<DeviceEvent> Next();
  // Fills in the identity and the problem.
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
