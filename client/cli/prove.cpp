#include "client/cli/prove.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "client/cli/device_test.h"
#include "client/cli/prove_steps.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

using Level = client::VerificationLevel;

constexpr double kSetUpS = 10.0, kCalibrateS = 60.0, kPollS = 0.5, kButtonPollS = 0.05;
constexpr double kRestS = 3.0, kButtonS = 30.0;
// A hand that holds the stylus still moves less.
constexpr double kMostRestMm = 10.0;

bool Streams(const client::DaemonInfo& info) {
  return info.health.connection == client::DeviceConnection::kStreaming;
}

// Why the daemon's device is not there, and what to do: as the daemon saw it, and as it is listed.
std::string ProblemOf(const Proof& proof) {
  std::string text = proof.daemon.health.problem;
  for (const client::ListedDevice& listed : proof.devices) {
    if (!listed.in_use || listed.problem.empty() || listed.problem == text) continue;
    text += (text.empty() ? "" : "; ") + listed.problem;
  }
  return text.empty() ? "the device does not stream: see palpated's log" : text;
}

}  // namespace

void ProveSteps::Run(const std::string& forces_of) {
  Find(forces_of);
  Calibrate();
  Rest();
  Axes();
  Orientation();
  Buttons();
  Raise(Level::kStateRead);
  if (!MayTryForces(forces_of)) return;
  Enable(forces_of);
  for (const Direction& direction : kDirections) Push(direction);
  Stop();
  Raise(Level::kForceVerified);
  Say("Forces are off again. All was right.");
}

void ProveSteps::EndForces(bool in_order) noexcept {
  if (!tried_forces_) return;
  try {
    if (in_order) {
      palpated_.DisableForces();
    } else {
      palpated_.StopForces();
    }
  } catch (const std::exception&) {
  }
}

void ProveSteps::Note(const Json& figures) {
  const std::chrono::duration<double, std::milli> since = std::chrono::steady_clock::now() - start_;
  Json step = {{"step", proof_.step}, {"ms", std::round(since.count())}};
  step.update(figures);
  proof_.steps.push_back(step);
}

void ProveSteps::Raise(Level level) {
  if (!proof_.rehearsal) proof_.level = level;
}

std::vector<client::Pose> ProveSteps::Read(double seconds) {
  std::vector<client::Pose> poses = palpated_.Read(seconds);
  proof_.readings.insert(proof_.readings.end(), poses.begin(), poses.end());
  return poses;
}

std::vector<client::Pose> ProveSteps::ReadFresh(double seconds) {
  palpated_.Follow();
  return Read(seconds);
}

bool ProveSteps::Await(double seconds,
                       const std::function<bool(const client::DaemonInfo&)>& holds) {
  for (double waited_s = 0.0; waited_s <= seconds; waited_s += kPollS) {
    if (holds(Get())) return true;
    palpated_.Read(kPollS);
  }
  return false;
}

void ProveSteps::Find(const std::string& forces_of) {
  Begin("find");
  palpated_.Follow();
  const std::string kind = Get().device.kind;
  proof_.devices = palpated_.ListDevices();
  proof_.rehearsal = device().verification_level == Level::kSimulated;
  if (proof_.rehearsal) {
    proof_.level = Level::kSimulated;
    Say("This is a rehearsal: with '" + OneLine(kind) +
        "' nothing is proven. Lead its hand with palpate-view.");
  }
  if (!forces_of.empty() && forces_of != kind) {
    Refuse("--forces names '" + forces_of + "', and the daemon's device is '" + kind +
           "': give --forces " + kind);
  }
  if (!Streams(proof_.daemon)) Say(fmt::format("Waiting up to {:g} s for it.", kSetUpS));
  if (!Await(kSetUpS, Streams)) {
    proof_.devices = palpated_.ListDevices();
    Unfit(ProblemOf(proof_));
  }
  Raise(proof_.daemon.health.identity.empty() ? Level::kEnumerated : Level::kIdentified);
  if (proof_.daemon.forces.state != client::ForceState::kOff) palpated_.DisableForces();
  const std::string& identity = proof_.daemon.health.identity;
  Say(OneLine(device().model) + (identity.empty() ? "" : "; " + OneLine(identity)));
  Note({{"identity", identity}});
}

void ProveSteps::Calibrate() {
  Begin("calibrate");
  const auto is_calibrated = [](const client::DaemonInfo& info) { return info.health.calibrated; };
  if (!is_calibrated(Get())) {
    const std::string problem = OneLine(proof_.daemon.health.problem);
    Say(problem.empty() ? "The device does not know where its stylus is yet." : problem);
    if (!Await(kCalibrateS, is_calibrated)) {
      Unfit(problem.empty() ? "not calibrated: see 'palpate device info'" : problem);
    }
  }
  Say("The device knows where its stylus is.");
  Note(Json::object());
}

void ProveSteps::Rest() {
  Begin("readings");
  Say("Let the stylus rest, or hold it still, and press Enter.");
  person_.WaitForEnter();
  DeviceTest test(Get());
  for (const client::Pose& pose : ReadFresh(kRestS)) test.Add(pose);
  const DeviceTestFigures figures = test.Figures(Get());
  Note(ToJson(figures));
  if (!figures.failures.empty()) {
    throw Error(ErrorKind::kInternal, OneLine(figures.failures.front()));
  }
  for (const double range_mm : figures.range_mm) {
    if (range_mm <= kMostRestMm) continue;
    Unfit(fmt::format("the tip moved by {:.0f} mm: hold it still for three seconds", range_mm));
  }
  Say(fmt::format("{:.0f} per s, {:.2f} % lost; it moved within {:.3f} x {:.3f} x {:.3f} mm",
                  figures.is_simulated ? figures.ticks_per_s : figures.readings_per_s,
                  figures.lost_percent, figures.range_mm[0], figures.range_mm[1],
                  figures.range_mm[2]));
}

void ProveSteps::Axes() {
  Begin("axes");
  Vec3 before_mm = PlaceOf(ReadFresh(kProvePlaceS));
  for (const Direction& direction : kDirections) {
    if (direction.sign < 0.0) continue;
    Say(fmt::format("Move the tip about 5 cm {}, hold it there, and press Enter.",
                    direction.words));
    person_.WaitForEnter();
    const Vec3 after_mm = PlaceOf(ReadFresh(kProvePlaceS));
    const Vec3 way_mm = after_mm - before_mm;
    const std::string problem = ProblemOfWay(way_mm, direction);
    Note({{"asked", direction.words},
          {"before_mm", ToJson(before_mm)},
          {"after_mm", ToJson(after_mm)},
          {"right", problem.empty()}});
    if (!problem.empty()) Unfit(problem);
    Say(fmt::format("{:.1f} mm {}", way_mm.dot(direction.unit()), direction.words));
    before_mm = after_mm;
  }
}

void ProveSteps::Orientation() {
  Begin("pointing");
  if (!device().senses_orientation || proof_.rehearsal) return;
  for (const Direction& direction : {kDirections[5], kDirections[3], kDirections[0]}) {
    Say(fmt::format("Point the stylus {}, as well as it goes, and press Enter.", direction.words));
    person_.WaitForEnter();
    const std::vector<client::Pose> poses = ReadFresh(kProvePlaceS);
    if (poses.empty()) Unfit("no ticks came: see palpated's log");
    const Vec3 points = PointingOf(poses.back());
    const std::string problem = ProblemOfPointing(points, direction);
    Note({{"asked", direction.words}, {"points", ToJson(points)}, {"right", problem.empty()}});
    if (!problem.empty()) Unfit(problem);
  }
}

void ProveSteps::Buttons() {
  Begin("buttons");
  const std::uint32_t count = std::min(device().button_count, 32u);
  if (count == 0) return Say("It has none.");
  Say(fmt::format("Press each of the {} buttons once, one at a time, in any order.", count));
  palpated_.Follow();
  std::uint32_t released = 0, pressed = 0;  // at any time so far
  double waited_s = 0.0;
  for (std::uint32_t seen = 0; seen < count;) {
    const std::uint32_t before = pressed;
    for (const client::Pose& pose : Read(kButtonPollS)) {
      pressed |= pose.buttons & released;
      released |= ~pose.buttons;
    }
    waited_s = pressed == before ? waited_s + kButtonPollS : 0.0;
    for (std::uint32_t n = 0; n < count; ++n) {
      if (((pressed & ~before) >> n & 1u) == 0) continue;
      ++seen;
      Say(fmt::format("button {}", n));
      Note({{"button", n}});
    }
    if (waited_s <= kButtonS) continue;
    std::uint32_t missing = 0;
    while ((pressed >> missing & 1u) != 0) ++missing;
    Unfit(
        fmt::format("button {} did not come within {:g} s: press it and let it go; if it does "
                    "not come then, send the folder",
                    missing, kButtonS));
  }
}

Proof Prove(ProvedDaemon& palpated, Person& person, const std::string& forces_of) {
  Proof proof;
  ProveSteps steps(palpated, person, proof);
  try {
    steps.Run(forces_of);
  } catch (const Error& error) {
    proof.refusal = error;
  } catch (...) {
    steps.EndForces(false);
    throw;
  }
  steps.EndForces(!proof.refusal);
  return proof;
}

}  // namespace palpate::cli
