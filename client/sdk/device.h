// The device, its forces and the haptic loop of the daemon. Fields mean what device.proto says.
//
// Units: in the names; frame D.
// Threads: plain values.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/sdk/pose.h"
#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

using palpate::DeviceConnection;
using palpate::Role;
using palpate::VerificationLevel;

struct DeviceInfo {
  std::string kind;   // configuration name, such as "simulated"
  std::string model;  // for people
  Vec3 workspace_min_mm = Vec3::Zero();
  Vec3 workspace_max_mm = Vec3::Zero();
  double max_force_n = 0.0;
  double continuous_force_n = 0.0;
  double max_stiffness_n_per_mm = 0.0;  // 0: not known
  double position_resolution_mm = 0.0;
  std::uint32_t button_count = 0;
  VerificationLevel verification_level = VerificationLevel::kUnknown;
};

// Counts start with the daemon.
struct DeviceHealth {
  DeviceConnection connection = DeviceConnection::kUnknown;
  bool docked = false;
  bool calibrated = false;
  std::string identity;  // serial number and firmware; empty: not known
  std::string problem;   // what is wrong and what to do; empty: nothing
  std::uint64_t readings = 0;
  std::uint64_t forces_written = 0;
  std::uint64_t lost_readings = 0;
  std::uint64_t corrupt_frames = 0;
  std::uint64_t transfer_errors = 0;
  std::uint64_t connections = 0;
  std::uint64_t watchdog_zeros = 0;  // zero forces because the servo did not tick
};

struct ServoInfo {
  double rate_hz = 0.0;
  bool realtime_scheduling = false;
  bool memory_locked = false;
  std::vector<std::string> warnings;  // what the loop lacks, one line each
  std::uint64_t ticks = 0;
  std::uint64_t missed_ticks = 0;
  std::uint64_t faulty_ticks = 0;    // with zero force because of device, position or force
  std::uint64_t scenes_applied = 0;  // number of the newest scene in use
  std::int64_t page_faults = 0;
  std::uint64_t lost_samples = 0;  // samples that no stream could get
  std::string version;             // of the daemon
};

struct DaemonInfo {
  DeviceInfo device;
  DeviceHealth health;
  ForceStatus forces;
  // Who enabled, disabled or stopped forces last: "token or-2 at ipv4:192.0.2.7:51544". Empty: no
  // client since the daemon's start.
  std::string forces_set_by;
  // Who leads the simulated hand, in the same form. Empty: nobody does.
  std::string hand_led_by;
  ServoInfo servo;
  // The identity that the daemon has verified: "token or-2", "local socket". Empty: the daemon does
  // not say.
  std::string identity;
  Role role = Role::kUnknown;
};

// A device of the daemon's machine.
struct ListedDevice {
  std::string kind{};
  std::string model{};
  std::string port{};  // such as USB "1-2"; empty if the device has no port
  bool usable = false;
  std::string problem{};  // what is missing and what to do; empty if the device is usable
  VerificationLevel verification_level = VerificationLevel::kUnknown;
  bool in_use = false;
};

struct ForceResult {
  ForceStatus forces;
  std::uint64_t applied_tick = 0;  // first tick with that state
};

}  // namespace palpate::client
