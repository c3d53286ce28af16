// The result of one tick of the servo thread. Trivially copyable: it goes through the ring to the
// pump thread.
//
// Frame: D (mm, N, N mm). Times: ns of CLOCK_MONOTONIC. Densities and isovalues: data units.
// palpate.v1.PoseSample has the same fields and explains them.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>
#include <type_traits>

#include "common/contract/enumerations.h"
#include "server/haptics/settings.h"
#include "server/safety/safety.h"

namespace palpate {

// Where SCP_H is in the decomposed volume, which SCP_V follows from.
struct SurfacePlace {
  double isovalue = 0.0;  // normalised and felt
  std::array<int, 3> cell{};
  std::uint8_t vertex_count = 0;  // of the smallest simplex that holds SCP_H; 0: not on H
  std::array<std::uint8_t, 4> vertex{};
  std::array<double, 4> weight{};
};

struct TickSample {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;
  std::array<double, 3> hip_mm{};
  std::array<double, 3> scp_h_mm{};
  std::array<double, 3> scp_h_normal{};
  std::array<double, 3> scp_v_mm{};
  std::array<double, 3> scp_v_normal{};
  std::array<double, 4> stylus_orientation{1.0, 0.0, 0.0, 0.0};  // w, x, y, z
  std::array<double, 3> force_n{};
  std::array<double, 3> torque_n_mm{};
  std::array<double, 3> led_target_mm{kNone, kNone, kNone};  // kNone: nobody leads the hand
  std::array<double, 3> push_n{kNone, kNone, kNone};         // kNone: nobody tries the motors
  std::array<double, 4> tool_orientation{kNone, kNone, kNone, kNone};  // kNone: no tool
  double density = 0.0;
  double isovalue = 0.0;
  double force_limit_n = 0.0;             // the greatest force that the motors' warmth allows
  double torque_limit_n_mm = 0.0;         // as force_limit_n
  double series_position_frames = kNone;  // kNone: the volume is no series
  double tool_radius_mm = 0.0;            // of the ball that is felt; 0: a point
  std::uint64_t touching_balls = 0;       // bit n: ball n holds the tool back
  std::uint64_t scene_revision = 0;       // rises with everything that is published to the servo
  std::uint64_t settings_revision = 0;
  std::uint64_t volume_revision = 0;
  std::int64_t update_ns = 0;
  std::uint64_t missed_ticks = 0;
  std::uint64_t capped_ticks = 0;
  std::uint64_t faulty_ticks = 0;
  std::uint32_t buttons = 0;
  std::uint32_t iterations = 0;
  // The servo leaves SCP_V out and tells this; pose_of.h adds SCP_V. Not recorded.
  SurfacePlace surface_place{};
  // Of H in this tick.
  std::uint32_t refinement = 1;
  // 0 without layers.
  std::uint32_t layers_passed = 0;
  std::uint32_t contact_layer = 0;  // its id; 0: no contact
  ProxyMode mode = ProxyMode::kFree;
  FreeSide free_side = FreeSide::kBelow;
  bool contact = false;
  bool has_scp_v = false;
  bool input_rejected = false;  // invalid position; hip_mm is the last good one
  ForceState force_state = ForceState::kOff;
  ForceReason force_reason = ForceReason::kOperator;
  // The input of the safety stage.
  ForceCommand force_command = ForceCommand::kNone;
  DeviceStatus device_status = DeviceStatus::kOk;
  bool docked = false;
  bool calibrated = true;
  std::uint8_t hand = 0;
  // Shown to viewers in place of a live tick (SampleReplacement). The servo and recordings never
  // have such a sample, so recordings do not store this field.
  bool replayed = false;

  bool is_led() const { return !std::isnan(led_target_mm[0]); }
  bool has_tool() const { return !std::isnan(tool_orientation[0]); }
  bool is_pushed() const { return !std::isnan(push_n[0]); }
  bool shows_series() const { return !std::isnan(series_position_frames); }
};
static_assert(std::is_trivially_copyable_v<TickSample>);

inline constexpr std::uint64_t kKeyframeTicks = 64;

// The servo's state before a tick, as bytes. Ticks can be computed again from a keyframe, the
// scenes and the inputs, bit for bit. server/servo/servo_memory.h makes and reads the bytes.
//
// The servo makes a keyframe every kKeyframeTicks ticks without being asked, in 0.1 us. This needs
// no flag and no wait between threads, and every run does the same whether it is recorded or not. A
// recorder keeps only the keyframes that it needs: the first, one after each gap, and one a second.
//
// Threads: plain values.
//
// Trivially copyable: it goes through a ring to the pump thread.
struct ServoKeyframe {
  static constexpr std::size_t kBytes = 2400;

  std::uint64_t tick = 0;  // the tick that starts from this state
  std::size_t size = 0;    // of the bytes that are used
  std::array<char, kBytes> bytes{};

  std::string_view view() const { return {bytes.data(), size}; }
};
static_assert(std::is_trivially_copyable_v<ServoKeyframe>);

}  // namespace palpate
