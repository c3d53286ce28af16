// The result of one tick of the haptic loop.
//
// Frame: D, the device's: mm and N, x right, y up, z to the user. Densities and isovalues are in
// data units. Times are in ns of the daemon's CLOCK_MONOTONIC; on the same machine that is
// std::chrono::steady_clock.
// Threads: plain values.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

using palpate::ForceReason;
using palpate::ForceState;
using palpate::FreeSide;
using palpate::ProxyMode;

struct ForceStatus {
  ForceState state = ForceState::kUnknown;
  ForceReason reason = ForceReason::kUnknown;
  // The greatest force now. Warm motors lower it below the device's maximum.
  double limit_n = 0.0;
};

// The alignment of Eigen::Quaterniond depends on the compiler's flags. The program and the library
// may have different flags.
using UnalignedQuaternion = Eigen::Quaternion<double, Eigen::DontAlign>;

struct Pose {
  std::uint64_t tick = 0;  // ticks executed before this one since the daemon started
  std::int64_t time_ns = 0;
  Vec3 hip_mm = Vec3::Zero();
  Vec3 scp_h_mm = Vec3::Zero();
  // Points towards free space; none without contact.
  std::optional<Vec3> scp_h_normal;
  // None without contact, and if V is out of reach.
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
  std::uint64_t missed_ticks = 0;  // since the daemon started
  std::uint32_t iterations = 0;    // proxy moves in this tick
  std::uint64_t capped_ticks = 0;  // at the cap on proxy moves, since the daemon started
  FreeSide free_side = FreeSide::kBelow;
  ForceStatus forces;
  // A recording is replayed: this is a recorded tick in place of the live one. The forces are those
  // of the live tick.
  bool replayed = false;
};

// The samples of one message, or of all messages that waited during a slow callback.
struct PoseBatch {
  std::vector<Pose> poses;  // oldest first, at least one
  // Samples lost so far because this client was slow, over all connections.
  std::uint64_t dropped = 0;
  std::int64_t sent_time_ns = 0;  // of the newest message
  std::chrono::steady_clock::time_point received;
};

// The rate and the batch size of the pose stream.
struct PoseRate {
  // Samples per second of loop time, 20 to 1000. The minimum is 20, because the client sees changes
  // of settings only by poses.
  double rate_hz = 60.0;
  // Samples per message: 1 to 256, and at most 50 ms of samples. 0: the samples of 10 ms, at least
  // one. A larger batch costs less and has more delay.
  int batch = 0;
};

}  // namespace palpate::client
