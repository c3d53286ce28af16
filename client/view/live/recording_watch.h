// When the daemon's recording begins and ends, over one connection.
//
// Threads: one.
#pragma once

#include <optional>

namespace palpate::view {

enum class RecordingEvent { kNone, kBegun, kEnded };

class RecordingWatch {
 public:
  // Call it once per frame. `running`: whether the daemon records; none: it has not answered.
  RecordingEvent Take(std::optional<bool> running) {
    if (!running || *running == was_running_) return RecordingEvent::kNone;
    was_running_ = *running;
    return was_running_ ? RecordingEvent::kBegun : RecordingEvent::kEnded;
  }

 private:
  bool was_running_ = false;
};

}  // namespace palpate::view
