// What one tick of the haptic loop computed.
//
// Frame: D, the device's: mm and N, x right, y up, z to the user. Densities and
// isovalues in data units. Times in ns of the daemon's CLOCK_MONOTONIC, which on the
// same machine is std::chrono::steady_clock.
// Threads: plain values.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate::client {

// Names and meanings are those of device.proto.
enum class ForceState { kUnknown, kOff, kRampIn, kOn, kHeld, kFault, kStopped };
enum class ForceReason {
  kUnknown,
  kNone,
  kOperator,
  kDocked,
  kUncalibrated,
  kStale,
  kDeadlines,
  kDevice,
  kPosition,
  kForce,
  kSpeed,
  kStopCall,
  kStopButton,
};

struct ForceStatus {
  ForceState state = ForceState::kUnknown;
  ForceReason reason = ForceReason::kUnknown;
  double limit_n = 0.0;  // what the motors' warmth leaves of the greatest force
};

enum class ProxyMode { kUnknown, kFree, kConstrained, kEjecting, kFault, kSuspended };

// Side of the isosurface on which the stylus is free.
enum class FreeSide { kBelow, kAbove };

// A Quaterniond's alignment depends on the compiler's flags, which may be others in
// the program than they were in the library.
using UnalignedQuaternion = Eigen::Quaternion<double, Eigen::DontAlign>;

struct Pose {
  std::uint64_t tick = 0;  // ticks executed before it since the daemon started
  std::int64_t time_ns = 0;
  Vec3 hip_mm = Vec3::Zero();
  Vec3 scp_h_mm = Vec3::Zero();
  // Towards free space; none without contact.
  std::optional<Vec3> scp_h_normal;
  // None without contact, and where V is out of reach.
  std::optional<Vec3> scp_v_mm;
  std::optional<Vec3> scp_v_normal;
  // Rotates stylus axes into D; the stylus points along its -z.
  UnalignedQuaternion stylus_orientation = UnalignedQuaternion::Identity();
  std::uint32_t buttons = 0;  // bit n: button n is pressed
  Vec3 force_n = Vec3::Zero();
  ProxyMode mode = ProxyMode::kUnknown;
  bool contact = false;
  double density = 0.0;  // at SCP_H
  double isovalue = 0.0;
  std::uint64_t settings_revision = 0;
  std::uint64_t volume_revision = 0;
  std::int64_t update_ns = 0;      // duration of the haptic update
  std::uint64_t missed_ticks = 0;  // so far
  std::uint32_t iterations = 0;    // proxy moves in this tick
  std::uint64_t capped_ticks = 0;  // so far, in which the cap on proxy moves bit
  FreeSide free_side = FreeSide::kBelow;
  ForceStatus forces;
};

// What came in one message; after a slow callback, in all that piled up behind it.
struct PoseBatch {
  std::vector<Pose> poses;  // oldest first, at least one
  // Samples that were lost so far because this client was slow, over all
  // connections.
  std::uint64_t dropped = 0;
  std::int64_t sent_time_ns = 0;  // of the newest message
  std::chrono::steady_clock::time_point received;
};

// How many samples come, and how.
struct PoseRate {
  // Of loop time, 20 to 1000 Hz. Not less, for changes of settings are seen by them.
  double rate_hz = 60.0;
  // Samples per message, 1 to 256, and no more than 50 ms of them. 0: as many as
  // come within 10 ms, and one at least. A larger batch costs less and comes later.
  int batch = 0;
};

}  // namespace palpate::client
