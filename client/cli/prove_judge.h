// `palpate device prove`: judges ways of the tip, pushes and the stop by their figures.
//
// Frame D (mm, N): x right, y up, z towards the user. Pure; any thread.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/pose.h"

namespace palpate::cli {

// One of the six directions, as people say it.
struct Direction {
  const char* words;
  int axis;  // of frame D
  double sign;

  Vec3 unit() const { return sign * Vec3::Unit(axis); }
};
inline constexpr std::array<Direction, 6> kDirections = {{{"to the right", 0, 1.0},
                                                          {"to the left", 0, -1.0},
                                                          {"up", 1, 1.0},
                                                          {"down", 1, -1.0},
                                                          {"towards you", 2, 1.0},
                                                          {"away from you", 2, -1.0}}};

inline constexpr double kProvePushN = 0.3;

// The mean place of the tip. Not finite if there are no poses.
Vec3 PlaceOf(const std::vector<client::Pose>& poses);

// Returns what is wrong with a way of the tip, and what to do; empty: it went in that direction.
std::string ProblemOfWay(const Vec3& way_mm, const Direction& asked);

// Where the stylus points, as a unit vector.
Vec3 PointingOf(const client::Pose& pose);
// As ProblemOfWay.
std::string ProblemOfPointing(const Vec3& points, const Direction& asked);

struct PushFigures {
  Vec3 force_n = Vec3::Zero();  // of the tick that was nearest to the asked force
  int ticks = 0;                // with the asked force, as far as they were read
  double moved_mm = 0.0;        // along the direction
  bool against = false;         // the hand moved clearly the other way
};
// `first_tick`: the first with the push.
PushFigures MeasurePush(const std::vector<client::Pose>& poses, const Direction& direction,
                        std::uint64_t first_tick);
// Returns what is wrong, and what to do; empty: the force was written.
std::string ProblemOfPush(const PushFigures& figures);

struct StopFigures {
  bool pushed = false;                        // there was a push to stop
  std::optional<std::uint64_t> ticks_late{};  // from the stop to the first zero force; none: never
};
// `stop_tick`: the first tick that knew of the stop.
StopFigures MeasureStop(const std::vector<client::Pose>& poses, const Direction& direction,
                        std::uint64_t stop_tick);
std::string ProblemOfStop(const StopFigures& figures);

}  // namespace palpate::cli
