#include "client/cli/prove_steps.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "client/cli/description.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

constexpr double kLeastWayMm = 20.0;
constexpr double kLeastShare = 0.7;  // of the way, along the asked axis
constexpr double kPushN = 0.3;
constexpr double kForceToleranceN = 0.1 * kPushN;
// A hand feels a push of this length.
constexpr int kLeastPushTicks = 100;
constexpr double kAgainstMm = 3.0;
constexpr std::uint64_t kMostTicksLate = 2;
// A stop call of a busy machine takes some ticks.
constexpr std::uint64_t kShortly = 50;
constexpr const char* kWhatToDo =
    "start again to be sure; if it stays so, send the folder, and do not enable forces";

struct PushFigures {
  Vec3 force_n = Vec3::Zero();  // of the tick that was nearest to the asked force
  int ticks = 0;                // with the asked force, as far as they were read
  double moved_mm = 0.0;        // along the direction
  bool against = false;         // the hand moved clearly the other way
};

struct StopFigures {
  bool pushed = false;                        // there was a push to stop
  std::optional<std::uint64_t> ticks_late{};  // from the stop to the first zero force; none: never
};

constexpr char NameOfAxis(int axis) { return "xyz"[axis]; }

// The direction with the greatest part of the way.
const Direction& NearestTo(const Vec3& way) {
  return *std::max_element(kDirections.begin(), kDirections.end(), [&](const auto& a, auto& b) {
    return a.unit().dot(way) < b.unit().dot(way);
  });
}

bool IsAsked(const client::Pose& pose, const Direction& direction) {
  return (pose.force_n - kPushN * direction.unit()).norm() <= kForceToleranceN;
}

// `first_tick`: the first with the push.
PushFigures MeasurePush(const std::vector<client::Pose>& poses, const Direction& direction,
                        std::uint64_t first_tick) {
  const Vec3 asked_n = kPushN * direction.unit();
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

// Returns what is wrong, and what to do; empty: the force was written.
std::string ProblemOfPush(const PushFigures& figures) {
  if (figures.ticks >= kLeastPushTicks) return "";
  return fmt::format(
      "the daemon wrote {:.2f} N at best, and the asked {:g} N for {} ms only: start again",
      figures.force_n.norm(), kPushN, figures.ticks);
}

// `stop_tick`: the first tick that knew of the stop.
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

namespace {

// A machine that stood still for some ms holds a push back.
constexpr int kPushTries = 3;
constexpr double kRampInS = 5.0, kPushS = 1.0, kStoppedPushS = 2.0, kStopAfterS = 0.5;

// What held the forces back at last; empty: nothing.
std::string HeldBack(const std::vector<client::Pose>& poses) {
  const auto held = std::find_if(poses.rbegin(), poses.rend(), [](const client::Pose& pose) {
    return pose.forces.state == client::ForceState::kHeld ||
           pose.forces.state == client::ForceState::kFault;
  });
  return held == poses.rend() ? "" : "; they were " + InWords(held->forces);
}

}  // namespace

bool ProveSteps::MayTryForces(const std::string& forces_of) {
  if (device().max_force_n <= 0.0) {
    Say("The daemon has no figures of this device's motors ([device] motor_counts_per_n_mm), so "
        "forces are not tried: see the device guide.");
    return false;
  }
  if (!forces_of.empty()) return true;
  Say("Positions and buttons are right. To try the forces, too: palpate device prove --forces " +
      OneLine(device().kind));
  return false;
}

void ProveSteps::Enable(const std::string& kind) {
  Begin("enable");
  if (!proof_.rehearsal) {
    Say("Warning: the motors may push anywhere. Keep the device's power plug in reach.");
    Say("An arm with gravity compensation may lift when forces come on, and sink when they go "
        "off.");
  }
  Say("Hold the stylus loosely, away from the volume. Ctrl-C stops the forces. Press Enter.");
  person_.WaitForEnter();
  const std::vector<client::Pose> poses = ReadFresh(kProvePlaceS);
  if (!poses.empty() && poses.back().mode != client::ProxyMode::kFree) {
    Unfit(
        "the tip is at the volume, or in it: move it away, or make the volume small with "
        "'palpate place --scale-by 0.1', and start again");
  }
  tried_forces_ = true;
  palpated_.EnableForces(kind);
  const bool are_on = Await(kRampInS, [](const client::DaemonInfo& info) {
    return info.forces.state == client::ForceState::kOn;
  });
  Note({{"forces", ToJson(proof_.daemon.forces)}});
  if (!are_on) Unfit("the forces do not come on: " + InWords(proof_.daemon.forces));
  Say("Forces are on.");
}

std::uint64_t ProveSteps::PushHand(const Vec3& force_n, double seconds) {
  constexpr double kPauseS = 0.5, kMostS = 11.0;
  for (double waited_s = 0.0;; waited_s += kPauseS) {
    palpated_.Follow();
    try {
      return palpated_.PushHand(force_n, seconds);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kTooLarge || waited_s > kMostS) throw;
    }
    if (waited_s == 0.0) Say("The motors rest for some seconds first.");
    Read(kPauseS);
  }
}

void ProveSteps::Push(const Direction& direction) {
  Begin("push");
  for (int tries = 1; !TryPush(direction, tries == kPushTries); ++tries) {
  }
}

// Returns false if the push was held back, and may be tried again.
bool ProveSteps::TryPush(const Direction& direction, bool is_last) {
  Say(fmt::format("The next push is {}, {:g} N for {:g} s. Press Enter.", direction.words, kPushN,
                  kPushS));
  person_.WaitForEnter();
  const std::uint64_t tick = PushHand(kPushN * direction.unit(), kPushS);
  const std::vector<client::Pose> poses = Read(kPushS + kProvePlaceS);
  const PushFigures figures = MeasurePush(poses, direction, tick);
  const std::string problem = ProblemOfPush(figures);
  Json noted = {{"asked", direction.words},
                {"force_n", ToJson(figures.force_n)},
                {"ticks", figures.ticks},
                {"moved_mm", figures.moved_mm},
                {"moved_against", figures.against}};
  const bool felt =
      problem.empty() && person_.AskYesNo(fmt::format("Did it push {}?", direction.words));
  if (problem.empty()) noted["felt"] = felt;
  Note(noted);
  const std::string held = HeldBack(poses);
  if (!problem.empty() && !held.empty() && !is_last) {
    Say("The forces were held back for a moment. Once more.");
    return false;
  }
  if (!problem.empty()) Unfit(problem + held);
  if (felt) return true;
  Unfit(
      fmt::format("the push {} was not felt so: the motors' sign or axis {} is suspicious; "
                  "send the folder, and do not enable forces",
                  direction.words, "xyz"[direction.axis]));
}

void ProveSteps::Stop() {
  Begin("stop");
  constexpr const Direction& kUp = kDirections[2];
  Say("The last push is up, and is stopped early. Press Enter.");
  person_.WaitForEnter();
  PushHand(kPushN * kUp.unit(), kStoppedPushS);
  std::vector<client::Pose> poses = Read(kStopAfterS);
  const std::uint64_t tick = palpated_.StopForces();
  const std::uint64_t written = Get().health.forces_written;
  const std::vector<client::Pose> after = Read(kStopAfterS);
  poses.insert(poses.end(), after.begin(), after.end());
  const StopFigures figures = MeasureStop(poses, kUp, tick);
  const std::uint64_t zeros_written = Get().health.forces_written - written;
  std::string problem = ProblemOfStop(figures);
  if (problem.empty() && !proof_.rehearsal && zeros_written == 0) {
    problem = "the daemon wrote nothing to the device after the stop: pull the device's power plug";
  }
  const bool ended = problem.empty() && person_.AskYesNo("Did the push end at once?");
  Note({{"ms_to_zero", ToJson(figures.ticks_late)},
        {"writes_after", zeros_written},
        {"ended_at_once", problem.empty() ? Json(ended) : Json()}});
  if (!problem.empty()) Unfit(problem + HeldBack(poses));
  if (!ended) {
    Unfit("the device did not end the push at once: pull its power plug, and send the folder");
  }
}

}  // namespace palpate::cli
