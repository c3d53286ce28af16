#include <fmt/format.h>

#include <algorithm>

#include "client/cli/device_description.h"
#include "client/cli/prove_steps.h"
#include "common/error/one_line.h"

namespace palpate::cli {
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
  Say(fmt::format("The next push is {}, {:g} N for {:g} s. Press Enter.", direction.words,
                  kProvePushN, kPushS));
  person_.WaitForEnter();
  const std::uint64_t tick = PushHand(kProvePushN * direction.unit(), kPushS);
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
  PushHand(kProvePushN * kUp.unit(), kStoppedPushS);
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
