// `palpate device prove` with a person and a device that are made up: what it must accept, and each
// fault that it must refuse.
#include "client/cli/prove.h"

#include <gtest/gtest.h>

#include <functional>
#include <map>

namespace palpate::cli {
namespace {

using Level = client::VerificationLevel;
using State = client::ForceState;

// A device of 1000 readings per second and whoever holds it. Time passes only in Read.
class Rig final : public Person, public ProvedDaemon {
 public:
  Rig() {
    info.device.kind = "falcon";
    info.device.button_count = 2;
    info.device.max_force_n = 3.3;
    info.device.verification_level = Level::kNone;
    info.health.connection = client::DeviceConnection::kStreaming;
    info.health.calibrated = true;
    info.health.connections = 1;
    info.health.identity = "serial 7";
    info.servo.rate_hz = 1000.0;
    info.forces.state = State::kOff;
  }

  client::DaemonInfo info{};
  std::vector<client::ListedDevice> devices{};
  std::vector<Vec3> ways_mm = {{50, 3, 0}, {0, 50, 3}, {3, 0, 50}};
  std::vector<Vec3> points = {{0, 0, -1}, {0, -1, 0}, {1, 0, 0}};
  double sways_mm = 0.0;
  std::uint64_t readings_per_tick = 1;
  std::uint32_t working_buttons = 3;
  bool touches = false;
  bool forces_come = true, writes_after_stop = true;
  double written = 1.0;          // of the force
  Vec3 drags_mm = Vec3::Zero();  // in a tick with a push
  std::uint64_t stops_late = 0, longest_push = 9999;
  std::string cancels_in{}, denies_in{};  // steps
  std::uint64_t calibrated_at = 0;        // a tick

  int enabled = 0, disabled = 0, stopped = 0, pushed = 0;
  std::map<std::string, int> said{};  // how often, by step

  void Say(const std::string& step, const std::string&) override {
    step_ = step;
    ++said[step];
  }
  void WaitForEnter() override {
    if (step_ == cancels_in) throw Error(ErrorKind::kCancelled, "cancelled");
    if (step_ == "axes") place_mm_ += ways_mm.at(axes_++);
    if (step_ == "pointing") {
      R_DS_ = Eigen::Quaterniond::FromTwoVectors(-Vec3::UnitZ(), points.at(pointings_++));
    }
  }
  bool AskYesNo(const std::string&) override { return step_ != denies_in; }

  client::DaemonInfo GetDevice() override {
    if (calibrated_at > 0) info.health.calibrated = info.servo.ticks > calibrated_at;
    return info;
  }
  std::vector<client::ListedDevice> ListDevices() override { return devices; }
  void EnableForces(const std::string& kind) override {
    ++enabled;
    EXPECT_EQ(kind, info.device.kind);
    info.forces.state = forces_come ? State::kOn : State::kHeld;
  }
  void DisableForces() override {
    ++disabled;
    info.forces.state = State::kOff;
  }
  std::uint64_t StopForces() override {
    ++stopped;
    info.forces.state = State::kStopped;
    push_end_ = std::min(push_end_, info.servo.ticks + stops_late);
    return info.servo.ticks;
  }
  std::uint64_t PushHand(const Vec3& force_n, double seconds) override {
    ++pushed;
    EXPECT_LE(force_n.norm(), 0.5);
    push_n_ = written * force_n;
    const auto ticks = static_cast<std::uint64_t>(1e3 * seconds);
    push_end_ = info.servo.ticks + std::min(ticks, longest_push);
    return info.servo.ticks;
  }
  void Follow() override {}
  std::vector<client::Pose> Read(double seconds) override {
    Press();
    std::vector<client::Pose> poses(static_cast<std::size_t>(std::lround(1e3 * seconds)));
    for (client::Pose& pose : poses) Tick(pose);
    return poses;
  }

 private:
  void Press() {
    if (step_ != "buttons") return;
    const std::uint32_t button = 1u << std::min(presses_ / 2, 31u);
    buttons_ = ++presses_ % 2 == 0 ? button & working_buttons : 0;
  }
  void Tick(client::Pose& pose) {
    pose.tick = info.servo.ticks++;
    info.health.readings += readings_per_tick;
    if (info.forces.state != State::kStopped || writes_after_stop) ++info.health.forces_written;
    const bool pushes = pose.tick < push_end_;
    if (pushes) {
      pose.force_n = push_n_;
      place_mm_ += drags_mm;
    }
    pose.hip_mm = place_mm_ + Vec3(pose.tick % 2 == 0 ? sways_mm : 0.0, 0.0, 0.0);
    pose.stylus_orientation = R_DS_;
    pose.buttons = buttons_;
    pose.forces = info.forces;
    pose.mode = touches ? client::ProxyMode::kConstrained : client::ProxyMode::kFree;
  }

  std::string step_;
  Vec3 place_mm_ = Vec3::Zero(), push_n_ = Vec3::Zero();
  Eigen::Quaterniond R_DS_ = Eigen::Quaterniond::Identity();
  std::size_t axes_ = 0, pointings_ = 0;
  std::uint32_t buttons_ = 0, presses_ = 0;
  std::uint64_t push_end_ = 0;
};

TEST(Prove, AGoodDeviceIsProvenAndItsForcesEnd) {
  Rig rig;
  rig.drags_mm = {-0.01, 0.0, 0.0};
  const Proof proof = Prove(rig, rig, "falcon");
  ASSERT_FALSE(proof.refusal) << proof.refusal->what();
  EXPECT_EQ(proof.level, Level::kForceVerified);
  EXPECT_EQ(rig.pushed, 7);
  EXPECT_EQ(rig.stopped, 1);
  EXPECT_EQ(rig.disabled, 1);
  const Json json = ToJson(proof, {.client = "1.2.3"});
  EXPECT_EQ(json["proposed_level"], "force-verified");
  EXPECT_TRUE(json["refusal"].is_null());
  std::vector<Json> pushes;
  for (const Json& step : json["steps"]) {
    if (step["step"] == "push") pushes.push_back(step);
  }
  ASSERT_EQ(pushes.size(), 6u);
  EXPECT_TRUE(pushes[0]["moved_against"] && !pushes[1]["moved_against"]);
  EXPECT_EQ(json["steps"].back()["ms_to_zero"], 0);
  const std::string table = TableOf(proof.readings);
  EXPECT_EQ(std::ranges::count(table, '\n'), std::ssize(proof.readings) + 1);
}

TEST(Prove, WithoutForcesItEndsAfterTheReadings) {
  Rig not_asked, no_motors;
  no_motors.info.device.max_force_n = 0.0;
  no_motors.info.device.senses_orientation = true;
  no_motors.info.forces.state = State::kStopped;
  no_motors.calibrated_at = 2000;
  for (const auto& [rig, forces_of] : {std::pair(&not_asked, ""), {&no_motors, "falcon"}}) {
    const Proof proof = Prove(*rig, *rig, forces_of);
    EXPECT_FALSE(proof.refusal) << proof.refusal->what();
    EXPECT_EQ(proof.level, Level::kStateRead);
    EXPECT_EQ(rig->enabled, 0);
    EXPECT_EQ(rig->info.forces.state, State::kOff);
  }
  EXPECT_EQ(no_motors.said["pointing"], 3);
  EXPECT_EQ(not_asked.said["pointing"], 0);
}

TEST(Prove, ARehearsalProvesNothing) {
  Rig rig;
  rig.info.device.verification_level = Level::kSimulated;
  rig.writes_after_stop = false;
  const Proof proof = Prove(rig, rig, "falcon");
  ASSERT_FALSE(proof.refusal) << proof.refusal->what();
  EXPECT_TRUE(proof.rehearsal);
  EXPECT_EQ(proof.level, Level::kSimulated);
}

// What is not right, the step that refuses it, and the level until then.
TEST(Prove, EachFaultIsRefusedInItsStep) {
  struct Case {
    const char* name;
    std::function<void(Rig&)> spoil;
    const char* step;
    Level level = Level::kIdentified;
    std::string part{};  // of the refusal
  };
  using P = client::DeviceConnection;
  const std::vector<Case> cases = {
      {"absent", [](Rig& r) { r.info.health = {.connection = P::kAbsent, .problem = "plug it"}; },
       "find", Level::kNone, "plug it"},
      {"no right to open it",
       [](Rig& r) {
         r.info.health = {.connection = P::kAbsent};
         r.devices = {{.kind = "x", .problem = "other"}, {.problem = "rights", .in_use = true}};
       },
       "find", Level::kNone, "rights"},
      {"lost again", [](Rig& r) { r.info.health.connection = P::kConnecting; }, "find",
       Level::kNone},
      {"another kind", [](Rig& r) { r.info.device.kind = "omni-usb"; }, "find", Level::kNone},
      {"not calibrated", [](Rig& r) { r.calibrated_at = 100000; }, "calibrate"},
      {"no readings", [](Rig& r) { r.readings_per_tick = 0; }, "readings"},
      {"not held still", [](Rig& r) { r.sways_mm = 11.0; }, "readings"},
      {"mirrored",
       [](Rig& r) {
         r.ways_mm[0] = {-50, 3, 0};
       },
       "axes", Level::kIdentified, "mirrored"},
      {"swapped",
       [](Rig& r) {
         r.ways_mm[1] = {3, 0, 50};
       },
       "axes", Level::kIdentified, "y and z are swapped"},
      {"moved too little",
       [](Rig& r) {
         r.ways_mm[2] = {0, 0, 19};
       },
       "axes", Level::kIdentified, "19 mm"},
      {"askew",
       [](Rig& r) {
         r.ways_mm[2] = {35, 35, 40};
       },
       "axes"},
      {"the stylus turns wrongly",
       [](Rig& r) {
         r.info.device.senses_orientation = true;
         r.points[1] = {0, 1, 0};
       },
       "pointing"},
      {"a dead button", [](Rig& r) { r.working_buttons = 1; }, "buttons", Level::kIdentified,
       "button 1 "},
      {"cancelled before forces", [](Rig& r) { r.cancels_in = "readings"; }, "readings"},
      {"at the volume", [](Rig& r) { r.touches = true; }, "enable", Level::kStateRead},
      {"forces do not come", [](Rig& r) { r.forces_come = false; }, "enable", Level::kStateRead},
      {"no force written", [](Rig& r) { r.written = 0.0; }, "push", Level::kStateRead},
      {"the wrong force written", [](Rig& r) { r.written = -1.0; }, "push", Level::kStateRead},
      {"too small a force", [](Rig& r) { r.written = 0.89; }, "push", Level::kStateRead},
      {"felt elsewhere", [](Rig& r) { r.denies_in = "push"; }, "push", Level::kStateRead},
      {"cancelled with forces", [](Rig& r) { r.cancels_in = "push"; }, "push", Level::kStateRead},
      {"stops late", [](Rig& r) { r.stops_late = 3; }, "stop", Level::kStateRead},
      {"held back before the stop", [](Rig& r) { r.longest_push = 400; }, "stop", Level::kStateRead,
       "start again"},
      {"stops never", [](Rig& r) { r.stops_late = 9999; }, "stop", Level::kStateRead},
      {"zero not written", [](Rig& r) { r.writes_after_stop = false; }, "stop", Level::kStateRead},
      {"felt after the stop", [](Rig& r) { r.denies_in = "stop"; }, "stop", Level::kStateRead},
  };
  for (const auto& [name, spoil, step, level, part] : cases) {
    SCOPED_TRACE(name);
    Rig rig;
    spoil(rig);
    const Proof proof = Prove(rig, rig, "falcon");
    ASSERT_TRUE(proof.refusal);
    EXPECT_EQ(proof.step, step);
    EXPECT_EQ(proof.level, level);
    EXPECT_NE(std::string(proof.refusal->what()).find(part), std::string::npos)
        << proof.refusal->what();
    const bool touched_forces = rig.enabled > 0;
    EXPECT_EQ(rig.stopped > 0, touched_forces);
    EXPECT_TRUE(rig.info.forces.state == State::kOff || rig.info.forces.state == State::kStopped);
    EXPECT_EQ(ToJson(proof, {})["ended_at"], step);
  }
}

TEST(Prove, AStopThatIsTwoTicksLateIsGoodEnough) {
  Rig rig;
  rig.stops_late = 2;
  EXPECT_FALSE(Prove(rig, rig, "falcon").refusal);
}

// A fault that is no Error, such as a closed output.
TEST(Prove, ForcesEndWhateverHappens) {
  class Broken final : public Person {
   public:
    explicit Broken(Rig& rig) : rig_(rig) {}
    void Say(const std::string& step, const std::string& text) override { rig_.Say(step, text); }
    void WaitForEnter() override {
      if (rig_.pushed == 3) throw std::runtime_error("closed");
      rig_.WaitForEnter();
    }
    bool AskYesNo(const std::string&) override { return true; }

   private:
    Rig& rig_;
  };
  Rig rig;
  Broken person(rig);
  EXPECT_THROW(Prove(rig, person, "falcon"), std::runtime_error);
  EXPECT_EQ(rig.stopped, 1);
}

TEST(Prove, TheProofHasNoPaths) {
  Rig rig;
  rig.info.health = {.connection = client::DeviceConnection::kAbsent,
                     .problem = "the firmware '/home/ada smith/fw.bin' (or ~ada/x) is 3 N/mm off"};
  rig.devices = {{.kind = "replay", .problem = "/srv/patient 7/a.mcap is not there"}};
  const std::string text = ToText(ToJson(Prove(rig, rig, ""), {}));
  for (const char* part : {"ada", "smith", "patient", "mcap"}) {
    EXPECT_EQ(text.find(part), std::string::npos) << text;
  }
  EXPECT_EQ(WithoutPaths("a Phantom Omni / Touch, 3 N/mm"), "a Phantom Omni / Touch, 3 N/mm");
  EXPECT_EQ(WithoutPaths(""), "");
}

}  // namespace
}  // namespace palpate::cli
