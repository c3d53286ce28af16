// Written by proto/generate from palpate/v1/recorded.proto: change that.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/contract/enumerations.h"
#include "common/contract/pose.h"
#include "common/geometry/geometry.h"

namespace palpate {

struct RecordedTick {
  PoseSample pose{};
  // The command to the safety stage.
  ForceCommand force_command = ForceCommand::kUnknown;
  DeviceStatus device_status = DeviceStatus::kUnknown;
  // The stylus rests in its holder.
  bool docked = false;
  // The device knows where its stylus is.
  bool calibrated = false;
  // The device gave no position: hip_mm is the last good one.
  bool input_rejected = false;
  // The scene that the tick used.
  std::uint64_t scene_revision = 0;
  // Ticks so far with zero force because of a fault.
  std::uint64_t faulty_ticks = 0;
  // Where somebody who leads the simulated hand wants it. Absent: nobody leads it.
  std::optional<Vec3> led_target_mm{};
  // Of the series, as SeriesState.position_frames. Absent: the volume is no series.
  std::optional<double> series_position_frames{};
  // The force of PushHand, in N. Absent: nobody tries the motors.
  std::optional<Vec3> push_n{};
  friend bool operator==(const RecordedTick&, const RecordedTick&) = default;
};
template <class Visit>
void VisitFields(const RecordedTick& value, Visit&& visit) {
  visit("pose", value.pose);
  visit("force_command", value.force_command);
  visit("device_status", value.device_status);
  visit("docked", value.docked);
  visit("calibrated", value.calibrated);
  visit("input_rejected", value.input_rejected);
  visit("scene_revision", value.scene_revision);
  visit("faulty_ticks", value.faulty_ticks);
  visit("led_target_mm", value.led_target_mm);
  visit("series_position_frames", value.series_position_frames);
  visit("push_n", value.push_n);
}
template <class Visit>
void VisitFields(RecordedTick& value, Visit&& visit) {
  visit("pose", value.pose);
  visit("force_command", value.force_command);
  visit("device_status", value.device_status);
  visit("docked", value.docked);
  visit("calibrated", value.calibrated);
  visit("input_rejected", value.input_rejected);
  visit("scene_revision", value.scene_revision);
  visit("faulty_ticks", value.faulty_ticks);
  visit("led_target_mm", value.led_target_mm);
  visit("series_position_frames", value.series_position_frames);
  visit("push_n", value.push_n);
}

// The servo's state before a tick. A replay can start there.
struct RecordedKeyframe {
  std::uint64_t tick = 0;
  // server/servo/servo_memory.h.
  std::string state{};
  friend bool operator==(const RecordedKeyframe&, const RecordedKeyframe&) = default;
};
template <class Visit>
void VisitFields(const RecordedKeyframe& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("state", value.state);
}
template <class Visit>
void VisitFields(RecordedKeyframe& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("state", value.state);
}

struct RecordedEvent {
  // The last recorded tick that began at or before time_ns; if none did, the first recorded
  // one.
  std::uint64_t tick = 0;
  // On the clock of PoseSample.time_ns.
  std::int64_t time_ns = 0;
  // The text of a marker (RecordingService.Mark).
  std::string marker{};
  friend bool operator==(const RecordedEvent&, const RecordedEvent&) = default;
};
template <class Visit>
void VisitFields(const RecordedEvent& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("time_ns", value.time_ns);
  visit("marker", value.marker);
}
template <class Visit>
void VisitFields(RecordedEvent& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("time_ns", value.time_ns);
  visit("marker", value.marker);
}

// Two clocks at the same moment.
struct RecordedClock {
  // CLOCK_MONOTONIC.
  std::int64_t time_ns = 0;
  // UTC, since 1970.
  std::int64_t unix_ns = 0;
  friend bool operator==(const RecordedClock&, const RecordedClock&) = default;
};
template <class Visit>
void VisitFields(const RecordedClock& value, Visit&& visit) {
  visit("time_ns", value.time_ns);
  visit("unix_ns", value.unix_ns);
}
template <class Visit>
void VisitFields(RecordedClock& value, Visit&& visit) {
  visit("time_ns", value.time_ns);
  visit("unix_ns", value.unix_ns);
}

}  // namespace palpate
