#include "client/cli/prove_judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::cli {
namespace {

constexpr double kLeastWayMm = 20.0;
constexpr double kLeastShare = 0.7;  // of the way, along the asked axis
constexpr double kForceToleranceN = 0.1 * kProvePushN;
// A hand feels a push of this length.
constexpr int kLeastPushTicks = 100;
constexpr double kAgainstMm = 3.0;
constexpr std::uint64_t kMostTicksLate = 2;
// A stop call of a busy machine takes some ticks.
constexpr std::uint64_t kShortly = 50;
constexpr const char* kWhatToDo =
    "start again to be sure; if it stays so, send the folder, and do not enable forces";

constexpr char NameOfAxis(int axis) { return "xyz"[axis]; }

// The direction with the greatest part of the way.
const Direction& NearestTo(const Vec3& way) {
  return *std::max_element(kDirections.begin(), kDirections.end(), [&](const auto& a, auto& b) {
    return a.unit().dot(way) < b.unit().dot(way);
  });
}

bool IsAsked(const client::Pose& pose, const Direction& direction) {
  return (pose.force_n - kProvePushN * direction.unit()).norm() <= kForceToleranceN;
}

}  // namespace

Vec3 PlaceOf(const std::vector<client::Pose>& poses) {
  if (poses.empty()) return Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  Vec3 sum = Vec3::Zero();
  for (const client::Pose& pose : poses) sum += pose.hip_mm;
  return sum / static_cast<double>(poses.size());
}

std::string ProblemOfWay(const Vec3& way_mm, const Direction& asked) {
  const double length_mm = way_mm.norm();
  if (!(length_mm >= kLeastWayMm)) {
    return fmt::format(
        "the tip moved only {:.0f} mm: move it about 50 mm, and hold it there until you have "
        "pressed Enter",
        length_mm);
  }
  const Direction& seen = NearestTo(way_mm);
  const std::string read =
      fmt::format("the device reads {}, and not {}: ", seen.words, asked.words);
  if (seen.axis != asked.axis) {
    return read + fmt::format("the axes {} and {} are swapped; {}", NameOfAxis(asked.axis),
                              NameOfAxis(seen.axis), kWhatToDo);
  }
  if (seen.sign != asked.sign) {
    return read + fmt::format("the axis {} is mirrored; {}", NameOfAxis(asked.axis), kWhatToDo);
  }
  const double share = way_mm.dot(asked.unit()) / length_mm;
  if (share >= kLeastShare) return "";
  return fmt::format("only {:.0f} % of the way is {}: move it straight; {}", 100.0 * share,
                     asked.words, kWhatToDo);
}

Vec3 PointingOf(const client::Pose& pose) {
  return Eigen::Quaterniond(pose.stylus_orientation) * -Vec3::UnitZ();
}

std::string ProblemOfPointing(const Vec3& points, const Direction& asked) {
  if (points.dot(asked.unit()) >= kLeastShare) return "";
  return fmt::format("the device reads that the stylus points {}, and not {}: {}",
                     NearestTo(points).words, asked.words, kWhatToDo);
}

PushFigures MeasurePush(const std::vector<client::Pose>& poses, const Direction& direction,
                        std::uint64_t first_tick) {
  const Vec3 asked_n = kProvePushN * direction.unit();
  PushFigures figures;
  std::optional<Vec3> first_mm;
  for (const client::Pose& pose : poses) {
    if (pose.tick < first_tick) continue;
    if (!first_mm) first_mm = pose.hip_mm;
    if ((pose.force_n - asked_n).norm() < (figures.force_n - asked_n).norm()) {
      figures.force_n = pose.force_n;
    }
    if (!IsAsked(pose, direction)) continue;
    ++figures.ticks;
    figures.moved_mm = (pose.hip_mm - *first_mm).dot(direction.unit());
  }
  figures.against = figures.moved_mm <= -kAgainstMm;
  return figures;
}

std::string ProblemOfPush(const PushFigures& figures) {
  if (figures.ticks >= kLeastPushTicks) return "";
  return fmt::format(
      "the daemon wrote {:.2f} N at best, and the asked {:g} N for {} ms only: start again",
      figures.force_n.norm(), kProvePushN, figures.ticks);
}

StopFigures MeasureStop(const std::vector<client::Pose>& poses, const Direction& direction,
                        std::uint64_t stop_tick) {
  StopFigures figures;
  for (const client::Pose& pose : poses) {
    const bool is_shortly_before = pose.tick < stop_tick && pose.tick + kShortly >= stop_tick;
    figures.pushed = figures.pushed || (is_shortly_before && IsAsked(pose, direction));
    const bool is_first_zero =
        !figures.ticks_late && pose.tick >= stop_tick && (pose.force_n.array() == 0.0).all();
    if (is_first_zero) figures.ticks_late = pose.tick - stop_tick;
  }
  return figures;
}

std::string ProblemOfStop(const StopFigures& figures) {
  if (!figures.pushed) {
    return "the push had ended before the stop: start again";
  }
  if (!figures.ticks_late) {
    return "the force did not become zero after the stop: pull the device's power plug";
  }
  if (*figures.ticks_late <= kMostTicksLate) return "";
  return fmt::format(
      "the force became zero {} ms after the stop, which is more than {} ms: see the warnings of "
      "'palpate info', and start again",
      *figures.ticks_late, kMostTicksLate);
}

}  // namespace palpate::cli
