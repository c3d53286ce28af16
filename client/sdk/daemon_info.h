// The device, the time series and the recording of the daemon. Fields mean what
// device.proto, series.proto and recording.proto say.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/pose.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

enum class VerificationLevel {
  kUnknown,
  kNone,
  kEnumerated,
  kIdentified,
  kStateRead,
  kForceVerified,
  kSimulated,
};

// What we may do: each role may do all that the ones before it may.
enum class Role {
  kUnknown,   // of a daemon that does not say
  kViewer,    // watches
  kEditor,    // changes what is felt and seen: settings, voxels, place
  kOperator,  // drives the device; loads, saves and records
  kAdmin,
};

struct DeviceInfo {
  std::string kind;   // configuration name, such as "simulated"
  std::string model;  // for people
  Vec3 workspace_min_mm = Vec3::Zero();
  Vec3 workspace_max_mm = Vec3::Zero();
  double max_force_n = 0.0;
  double max_stiffness_n_per_mm = 0.0;
  std::uint32_t button_count = 0;
  VerificationLevel verification_level = VerificationLevel::kUnknown;
  bool streaming = false;  // it is there and read
  bool docked = false;
  bool calibrated = false;
  std::string problem;  // what is wrong and what to do; empty: nothing
  ForceStatus forces;
  std::string daemon_version;
  double loop_rate_hz = 0.0;
  std::vector<std::string> warnings;  // what the loop could not have, a line each
  // Whom the daemon takes us for: "token or-2", "local socket".
  std::string identity;
  Role role = Role::kUnknown;
};

struct ForceResult {
  ForceStatus forces;
  std::uint64_t applied_tick = 0;  // first tick with that state
};

struct SeriesState {
  std::uint32_t frames = 0;
  double position_frames = 0.0;  // 0 the first
  bool playing = false;
  double rate_hz = 0.0;  // frames per second, negative backwards
  bool loop = false;
  bool interpolate = false;
  std::uint64_t volume_revision = 0;
};

// What is absent stays.
struct SeriesControl {
  std::optional<bool> playing{};
  std::optional<double> position_frames{};
  std::optional<double> rate_hz{};
  std::optional<bool> loop{};
  std::optional<bool> interpolate{};
};

struct RecordingState {
  bool running = false;
  std::string path;  // on the daemon's machine
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;
  std::uint64_t size_bytes = 0;
  std::string error;  // why it ended early; empty: it did not
};

}  // namespace palpate::client
