// The result of one tick of the haptic loop, and the streams of them. pose.proto explains the
// fields.
//
// Frame: D, the device's: mm and N, x right, y up, z to the user. Densities and isovalues are in
// data units. Times are in ns of the daemon's CLOCK_MONOTONIC; on the same machine that is
// std::chrono::steady_clock.
// Threads: plain values.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

#include "common/contract/device.h"
#include "common/contract/enumerations.h"
#include "common/contract/pose.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

using palpate::ForceReason;
using palpate::ForceState;
using palpate::ForceStatus;
using palpate::FreeSide;
using palpate::ProxyMode;
using palpate::UnalignedQuaternion;

using Pose = PoseSample;

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
