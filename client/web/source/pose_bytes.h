// A pose as browsers get it: 176 bytes, little-endian. The page's wire/pose.ts reads it.
//
//   at   type    what
//     0  u8      1: a pose
//     1  u8      flags: PoseFlag
//     2  u8      client::ProxyMode
//     3  u8      client::ForceState
//     4  u32     sequence, written by the hub
//     8  f64     tick
//    16  f64     time of the tick [ms], palpated's CLOCK_MONOTONIC
//    24  f64     sent [ms], the gateway's CLOCK_MONOTONIC
//    32  f64     age when sent [ms]; NaN if the two clocks are of different machines
//    40  f64     settings_revision
//    48  f64     volume_revision
//    56  3 f32   HIP [mm]
//    68  3 f32   SCP_H [mm]
//    80  3 f32   normal at SCP_H; zero: none
//    92  3 f32   SCP_V [mm]; zero: none
//   104  4 f32   stylus orientation x, y, z, w
//   120  3 f32   force [N]
//   132  f32     greatest force now [N]
//   136  f32     density at SCP_H
//   140  f32     isovalue
//   144  u32     buttons
//   148  u32     missed ticks
//   152  f32     duration of the haptic update [us]
//   156  u8      client::ForceReason
//   157          zeros
//
// Frame: D. Threads: pure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "client/sdk/pose.h"

namespace palpate::web {

inline constexpr std::size_t kPoseBytes = 176;

enum PoseFlag : std::uint8_t {
  kContact = 1,
  kHasNormal = 2,
  kHasScpV = 4,
  kFreeAbove = 8,
  kFresh = 16,
  kReplayed = 32,
};

struct PoseSending {
  std::int64_t sent_ns = 0;   // the gateway's CLOCK_MONOTONIC
  bool shares_clock = false;  // with palpated
  bool is_fresh = false;      // palpated is connected
};

std::string EncodePose(const client::Pose& pose, const PoseSending& sending);

// A pose that another gateway sent, as this one sends it on: fresh if it was and is.
// `shares_clock`: this gateway with the other one, so that the age grows by the way; without, and
// if the two times contradict that, the age is NaN. None: the bytes are no pose.
std::optional<std::string> ForwardedPose(std::string_view bytes, const PoseSending& sending);

// Of a pose's bytes. NaN: not known.
double PoseAgeMs(std::string_view pose);

}  // namespace palpate::web
