// Written by proto/generate from palpate/v1/device.proto: change that.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate {

// The state of the forces, and its reason.
struct ForceStatus {
  // Whether the forces act.
  ForceState state = ForceState::kUnknown;
  // Why the forces do not act.
  ForceReason reason = ForceReason::kUnknown;
  // The force limit in N, after the limit for warm motors.
  double limit_n = 0.0;
  // As limit_n, of the torque; 0: the device has no motors for torque.
  double torque_limit_n_mm = 0.0;
  friend bool operator==(const ForceStatus&, const ForceStatus&) = default;
};
template <class Visit>
void VisitFields(const ForceStatus& value, Visit&& visit) {
  visit("state", value.state);
  visit("reason", value.reason);
  visit("limit_n", value.limit_n);
  visit("torque_limit_n_mm", value.torque_limit_n_mm);
}
template <class Visit>
void VisitFields(ForceStatus& value, Visit&& visit) {
  visit("state", value.state);
  visit("reason", value.reason);
  visit("limit_n", value.limit_n);
  visit("torque_limit_n_mm", value.torque_limit_n_mm);
}

// A device that the daemon could be configured to use.
struct ListedDevice {
  // Configuration name, for palpated.toml.
  std::string kind{};
  // Name for people.
  std::string model{};
  // Where it was found, such as USB port "1-2"; empty if the device needs no port.
  std::string port{};
  // True if the device is there and the daemon may open it.
  bool usable = false;
  // The problem and what to do; empty if usable.
  std::string problem{};
  // How much of its behaviour has been seen on hardware.
  VerificationLevel verification_level = VerificationLevel::kUnknown;
  // True if the daemon uses this device.
  bool in_use = false;
  // For [device] serial; empty: not known before the device is opened.
  std::string serial{};
  friend bool operator==(const ListedDevice&, const ListedDevice&) = default;
};
template <class Visit>
void VisitFields(const ListedDevice& value, Visit&& visit) {
  visit("kind", value.kind);
  visit("model", value.model);
  visit("port", value.port);
  visit("usable", value.usable);
  visit("problem", value.problem);
  visit("verification_level", value.verification_level);
  visit("in_use", value.in_use);
  visit("serial", value.serial);
}
template <class Visit>
void VisitFields(ListedDevice& value, Visit&& visit) {
  visit("kind", value.kind);
  visit("model", value.model);
  visit("port", value.port);
  visit("usable", value.usable);
  visit("problem", value.problem);
  visit("verification_level", value.verification_level);
  visit("in_use", value.in_use);
  visit("serial", value.serial);
}

// How the device is. Counts are since the daemon's start.
struct DeviceHealth {
  // Whether the device is there.
  DeviceConnection connection = DeviceConnection::kUnknown;
  // The stylus is in its place of rest.
  bool docked = false;
  // The device knows where its stylus is.
  bool calibrated = false;
  // Serial number and firmware as the device says; empty: unknown.
  std::string identity{};
  // The problem and what to do; empty: no problem.
  std::string problem{};
  // Readings of the device so far.
  std::uint64_t readings = 0;
  // Forces sent to the device so far.
  std::uint64_t forces_written = 0;
  // Readings lost, counted from gaps in the readings' numbers.
  std::uint64_t lost_readings = 0;
  // Frames with a wrong checksum or length.
  std::uint64_t corrupt_frames = 0;
  // Transfers that the bus did not complete.
  std::uint64_t transfer_errors = 0;
  // How often the device was set up.
  std::uint64_t connections = 0;
  // Zero forces written because the servo did not tick.
  std::uint64_t watchdog_zeros = 0;
  friend bool operator==(const DeviceHealth&, const DeviceHealth&) = default;
};
template <class Visit>
void VisitFields(const DeviceHealth& value, Visit&& visit) {
  visit("connection", value.connection);
  visit("docked", value.docked);
  visit("calibrated", value.calibrated);
  visit("identity", value.identity);
  visit("problem", value.problem);
  visit("readings", value.readings);
  visit("forces_written", value.forces_written);
  visit("lost_readings", value.lost_readings);
  visit("corrupt_frames", value.corrupt_frames);
  visit("transfer_errors", value.transfer_errors);
  visit("connections", value.connections);
  visit("watchdog_zeros", value.watchdog_zeros);
}
template <class Visit>
void VisitFields(DeviceHealth& value, Visit&& visit) {
  visit("connection", value.connection);
  visit("docked", value.docked);
  visit("calibrated", value.calibrated);
  visit("identity", value.identity);
  visit("problem", value.problem);
  visit("readings", value.readings);
  visit("forces_written", value.forces_written);
  visit("lost_readings", value.lost_readings);
  visit("corrupt_frames", value.corrupt_frames);
  visit("transfer_errors", value.transfer_errors);
  visit("connections", value.connections);
  visit("watchdog_zeros", value.watchdog_zeros);
}

// The caller as the daemon has recognised it.
struct CallerDescription {
  // "token or-2", "certificate viewer.lab.example", "local socket", "viewer socket",
  // "loopback". Empty: the daemon does not say.
  std::string identity{};
  Role role = Role::kUnknown;
  friend bool operator==(const CallerDescription&, const CallerDescription&) = default;
};
template <class Visit>
void VisitFields(const CallerDescription& value, Visit&& visit) {
  visit("identity", value.identity);
  visit("role", value.role);
}
template <class Visit>
void VisitFields(CallerDescription& value, Visit&& visit) {
  visit("identity", value.identity);
  visit("role", value.role);
}

// The device.
struct DeviceDescription {
  // Configuration name, such as "simulated".
  std::string kind{};
  // Name for people.
  std::string model{};
  // Corner of the workspace box in the device frame.
  Vec3 workspace_min_mm = Vec3::Zero();
  // The opposite corner.
  Vec3 workspace_max_mm = Vec3::Zero();
  // Greatest force of the device for a short time; 0: the daemon cannot drive its motors.
  double max_force_n = 0.0;
  // Greatest force that the device keeps up.
  double continuous_force_n = 0.0;
  // The greatest stiffness that the device renders without vibration; 0: not known.
  double max_stiffness_n_per_mm = 0.0;
  // Smallest motion that the device measures.
  double position_resolution_mm = 0.0;
  // Number of buttons.
  std::uint32_t button_count = 0;
  // How much of its behaviour has been seen on hardware.
  VerificationLevel verification_level = VerificationLevel::kUnknown;
  // Greatest torque of the device for a short time; 0: it has no motors for torque.
  double max_torque_n_mm = 0.0;
  // Greatest torque that the device keeps up; 0: it is not limited by heat.
  double continuous_torque_n_mm = 0.0;
  // It measures how its stylus is turned.
  bool senses_orientation = false;
  // When it is calibrated, its motors move its arm by themselves.
  bool calibration_moves_arm = false;
  friend bool operator==(const DeviceDescription&, const DeviceDescription&) = default;
};
template <class Visit>
void VisitFields(const DeviceDescription& value, Visit&& visit) {
  visit("kind", value.kind);
  visit("model", value.model);
  visit("workspace_min_mm", value.workspace_min_mm);
  visit("workspace_max_mm", value.workspace_max_mm);
  visit("max_force_n", value.max_force_n);
  visit("continuous_force_n", value.continuous_force_n);
  visit("max_stiffness_n_per_mm", value.max_stiffness_n_per_mm);
  visit("position_resolution_mm", value.position_resolution_mm);
  visit("button_count", value.button_count);
  visit("verification_level", value.verification_level);
  visit("max_torque_n_mm", value.max_torque_n_mm);
  visit("continuous_torque_n_mm", value.continuous_torque_n_mm);
  visit("senses_orientation", value.senses_orientation);
  visit("calibration_moves_arm", value.calibration_moves_arm);
}
template <class Visit>
void VisitFields(DeviceDescription& value, Visit&& visit) {
  visit("kind", value.kind);
  visit("model", value.model);
  visit("workspace_min_mm", value.workspace_min_mm);
  visit("workspace_max_mm", value.workspace_max_mm);
  visit("max_force_n", value.max_force_n);
  visit("continuous_force_n", value.continuous_force_n);
  visit("max_stiffness_n_per_mm", value.max_stiffness_n_per_mm);
  visit("position_resolution_mm", value.position_resolution_mm);
  visit("button_count", value.button_count);
  visit("verification_level", value.verification_level);
  visit("max_torque_n_mm", value.max_torque_n_mm);
  visit("continuous_torque_n_mm", value.continuous_torque_n_mm);
  visit("senses_orientation", value.senses_orientation);
  visit("calibration_moves_arm", value.calibration_moves_arm);
}

// The loop that drives the device.
struct ServoDescription {
  // Of the servo loop.
  double rate_hz = 0.0;
  // The system runs the servo before ordinary programs: SCHED_FIFO was granted.
  bool realtime_scheduling = false;
  // All memory of the process is locked.
  bool memory_locked = false;
  // Each line names one thing that the daemon could not get, and what to do.
  std::vector<std::string> warnings{};
  // Ticks of the servo so far.
  std::uint64_t ticks = 0;
  // Ticks skipped because their time had passed.
  std::uint64_t missed_ticks = 0;
  // Number of the newest scene (volume, isovalue, settings) in use. The servo may have skipped
  // older scenes.
  std::uint64_t scenes_applied = 0;
  // Version of the daemon.
  std::string version{};
  // Ticks with zero force because of the device, a bad position or a bad force.
  std::uint64_t faulty_ticks = 0;
  // Page faults of the servo thread since its first tick; counted once a second.
  std::int64_t page_faults = 0;
  // Samples that no stream could get because the pump thread was delayed.
  std::uint64_t lost_samples = 0;
  friend bool operator==(const ServoDescription&, const ServoDescription&) = default;
};
template <class Visit>
void VisitFields(const ServoDescription& value, Visit&& visit) {
  visit("rate_hz", value.rate_hz);
  visit("realtime_scheduling", value.realtime_scheduling);
  visit("memory_locked", value.memory_locked);
  visit("warnings", value.warnings);
  visit("ticks", value.ticks);
  visit("missed_ticks", value.missed_ticks);
  visit("scenes_applied", value.scenes_applied);
  visit("version", value.version);
  visit("faulty_ticks", value.faulty_ticks);
  visit("page_faults", value.page_faults);
  visit("lost_samples", value.lost_samples);
}
template <class Visit>
void VisitFields(ServoDescription& value, Visit&& visit) {
  visit("rate_hz", value.rate_hz);
  visit("realtime_scheduling", value.realtime_scheduling);
  visit("memory_locked", value.memory_locked);
  visit("warnings", value.warnings);
  visit("ticks", value.ticks);
  visit("missed_ticks", value.missed_ticks);
  visit("scenes_applied", value.scenes_applied);
  visit("version", value.version);
  visit("faulty_ticks", value.faulty_ticks);
  visit("page_faults", value.page_faults);
  visit("lost_samples", value.lost_samples);
}

struct EnableForcesResponse {
  ForceStatus forces{};
  // First tick with that state.
  std::uint64_t applied_tick = 0;
  friend bool operator==(const EnableForcesResponse&, const EnableForcesResponse&) = default;
};
template <class Visit>
void VisitFields(const EnableForcesResponse& value, Visit&& visit) {
  visit("forces", value.forces);
  visit("applied_tick", value.applied_tick);
}
template <class Visit>
void VisitFields(EnableForcesResponse& value, Visit&& visit) {
  visit("forces", value.forces);
  visit("applied_tick", value.applied_tick);
}

struct GetDeviceResponse {
  DeviceDescription device{};
  ServoDescription servo{};
  DeviceHealth health{};
  ForceStatus forces{};
  CallerDescription caller{};
  // Who enabled, disabled or stopped forces last, and from where: "local socket", "token or-2
  // at ipv4:192.0.2.7:51544". Empty: no client since the daemon's start.
  std::string forces_set_by{};
  // Who leads the simulated hand, as in forces_set_by. Empty: it explores by itself, or the
  // device is another one.
  std::string hand_led_by{};
  friend bool operator==(const GetDeviceResponse&, const GetDeviceResponse&) = default;
};
template <class Visit>
void VisitFields(const GetDeviceResponse& value, Visit&& visit) {
  visit("device", value.device);
  visit("servo", value.servo);
  visit("health", value.health);
  visit("forces", value.forces);
  visit("caller", value.caller);
  visit("forces_set_by", value.forces_set_by);
  visit("hand_led_by", value.hand_led_by);
}
template <class Visit>
void VisitFields(GetDeviceResponse& value, Visit&& visit) {
  visit("device", value.device);
  visit("servo", value.servo);
  visit("health", value.health);
  visit("forces", value.forces);
  visit("caller", value.caller);
  visit("forces_set_by", value.forces_set_by);
  visit("hand_led_by", value.hand_led_by);
}

// One hand: its device, and what the safety stage does with its forces.
struct Hand {
  // Its number, from 0.
  std::uint32_t hand = 0;
  DeviceDescription device{};
  DeviceHealth health{};
  // Unspecified before the first tick.
  ForceStatus forces{};
  // As in GetDeviceResponse, both.
  std::string forces_set_by{};
  std::string led_by{};
  friend bool operator==(const Hand&, const Hand&) = default;
};
template <class Visit>
void VisitFields(const Hand& value, Visit&& visit) {
  visit("hand", value.hand);
  visit("device", value.device);
  visit("health", value.health);
  visit("forces", value.forces);
  visit("forces_set_by", value.forces_set_by);
  visit("led_by", value.led_by);
}
template <class Visit>
void VisitFields(Hand& value, Visit&& visit) {
  visit("hand", value.hand);
  visit("device", value.device);
  visit("health", value.health);
  visit("forces", value.forces);
  visit("forces_set_by", value.forces_set_by);
  visit("led_by", value.led_by);
}

// The hands that feel, and the loop that drives them.
struct HandsState {
  std::vector<Hand> hands{};
  ServoDescription servo{};
  friend bool operator==(const HandsState&, const HandsState&) = default;
};
template <class Visit>
void VisitFields(const HandsState& value, Visit&& visit) {
  visit("hands", value.hands);
  visit("servo", value.servo);
}
template <class Visit>
void VisitFields(HandsState& value, Visit&& visit) {
  visit("hands", value.hands);
  visit("servo", value.servo);
}

}  // namespace palpate
