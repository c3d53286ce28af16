// `palpate device`: wording, tables, the judge of the device's test, and the program
// against a palpated with canned answers.
#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "client/cli/device_description.h"
#include "client/cli/device_test.h"
#include "client/cli/doctor_daemon.h"
#include "client/cli/watch_view.h"
#include "client/sdk/words.h"
#include "common/wire/force_words.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/cli_fake_daemon.h"

namespace palpate::cli {
namespace {

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Of an enum of the wire, but UNSPECIFIED.
template <typename Enum>
std::vector<Enum> AllOf(const google::protobuf::EnumDescriptor* descriptor) {
  std::vector<Enum> values;
  for (int n = 1; n < descriptor->value_count(); ++n) {
    values.push_back(static_cast<Enum>(descriptor->value(n)->number()));
  }
  return values;
}

TEST(DeviceWords, EveryReasonHasWordsOfItsOwnOnOneLine) {
  std::set<std::string> words;
  for (const auto reason : AllOf<v1::ForceReason>(v1::ForceReason_descriptor())) {
    const std::string text = palpate::InWords(reason);
    EXPECT_EQ(text.empty(), reason == v1::FORCE_REASON_NONE) << v1::ForceReason_Name(reason);
    EXPECT_FALSE(Has(text, "\n"));
    EXPECT_TRUE(words.insert(text).second) << text;
    EXPECT_TRUE(words.insert(palpate::NameOf(reason)).second);
  }
  for (const auto state : AllOf<v1::ForceState>(v1::ForceState_descriptor())) {
    EXPECT_TRUE(words.insert("state " + palpate::NameOf(state)).second);
  }
  EXPECT_EQ(palpate::NameOf(v1::FORCE_STATE_RAMP_IN), "ramp_in");
  EXPECT_EQ(palpate::NameOf(v1::FORCE_REASON_STOP_CALL), "stop_call");
  // Of a newer daemon.
  EXPECT_EQ(palpate::NameOf(static_cast<v1::ForceState>(99)), "unknown");
  EXPECT_EQ(palpate::InWords(static_cast<v1::ForceReason>(99)), "");
}

TEST(DeviceWords, EveryLevelIsExplained) {
  for (const auto number : AllOf<v1::VerificationLevel>(v1::VerificationLevel_descriptor())) {
    const auto level = static_cast<client::VerificationLevel>(number);
    EXPECT_TRUE(Has(InWords(level), ": ")) << InWords(level);
    EXPECT_NE(client::NameOf(level), "unknown");
  }
  EXPECT_EQ(InWords(client::VerificationLevel::kNone), "none: nothing of it was seen on hardware");
}

client::ForceStatus Forces(client::ForceState state, client::ForceReason reason) {
  return {state, reason, 3.3};
}

TEST(DeviceWords, ForcesAreToldWithWhatToDo) {
  EXPECT_EQ(Describe(Forces(client::ForceState::kOn, client::ForceReason::kNone)),
            "forces    on\n          at most 3.3 N now\n");
  const client::ForceStatus docked =
      Forces(client::ForceState::kHeld, client::ForceReason::kDocked);
  EXPECT_EQ(InWords(docked), "held: the stylus rests in its holder: take it out");
  EXPECT_EQ(NameOf(docked), "held (docked)");
  EXPECT_EQ(NameOf(Forces(client::ForceState::kRampIn, client::ForceReason::kNone)), "ramp in");
}

TEST(DeviceWords, HealthLeavesOutWhatSaysNothing) {
  client::DeviceHealth health;
  health.connection = client::DeviceConnection::kStreaming;
  health.calibrated = true;
  EXPECT_EQ(Describe(health), "health    streaming, calibrated\n");
  health.docked = true;
  health.identity = "serial 7";
  health.readings = 12;
  health.lost_readings = 3;
  health.problem = "evil\n\x1b[2Jdevice";
  const std::string text = Describe(health);
  for (const char* part : {"streaming, calibrated, docked; serial 7", "12 readings, 3 lost",
                           "problem: evil  [2Jdevice\n"}) {
    EXPECT_TRUE(Has(text, part)) << part << "\n" << text;
  }
}

client::ServoInfo Ticked(std::uint64_t ticks, std::uint64_t missed) {
  client::ServoInfo servo;
  servo.ticks = ticks;
  servo.missed_ticks = missed;
  return servo;
}

TEST(DoctorDaemon, TicksAreCountedWhileItLooks) {
  EXPECT_EQ(JudgeTicks(Ticked(1000, 50), Ticked(1300, 50)).verdict, Verdict::kOk);
  EXPECT_EQ(JudgeTicks(Ticked(1000, 50), Ticked(1285, 65)).verdict, Verdict::kOk);
  const Finding late = JudgeTicks(Ticked(1000, 50), Ticked(1284, 66));
  EXPECT_EQ(late.verdict, Verdict::kWarn);
  EXPECT_EQ(late.text, "284 ticks while it was watched, 16 missed");
  const Finding stuck = JudgeTicks(Ticked(1000, 50), Ticked(1000, 50));
  EXPECT_EQ(stuck.verdict, Verdict::kFail);
  EXPECT_NE(stuck.advice.find("palpated"), std::string::npos);
}

TEST(DoctorDaemon, ADeviceIsFitWhereItStreamsWithoutAProblem) {
  client::DaemonInfo daemon;
  daemon.device.kind = "falcon";
  client::DeviceHealth& health = daemon.health;
  health.connection = client::DeviceConnection::kStreaming;
  EXPECT_EQ(JudgeDevice(daemon).verdict, Verdict::kOk);
  EXPECT_EQ(JudgeDevice(daemon).text, "falcon, streaming");
  health.problem = "move it to\nits stops";
  EXPECT_EQ(JudgeDevice(daemon).verdict, Verdict::kWarn);
  EXPECT_EQ(JudgeDevice(daemon).text, "falcon, streaming: move it to its stops");
  health.connection = client::DeviceConnection::kAbsent;
  EXPECT_EQ(JudgeDevice(daemon).verdict, Verdict::kFail);
  EXPECT_NE(JudgeDevice(daemon).advice, "");
}

TEST(DoctorDaemon, ForcesThatAreNotOnSayWhatToDo) {
  const std::map<client::ForceState, Verdict> verdicts = {
      {client::ForceState::kOn, Verdict::kOk},        {client::ForceState::kRampIn, Verdict::kOk},
      {client::ForceState::kOff, Verdict::kWarn},     {client::ForceState::kHeld, Verdict::kWarn},
      {client::ForceState::kStopped, Verdict::kWarn}, {client::ForceState::kFault, Verdict::kFail}};
  for (const auto& [state, verdict] : verdicts) {
    client::ForceStatus forces;
    forces.state = state;
    EXPECT_EQ(JudgeForces(forces).verdict, verdict) << client::NameOf(state);
    EXPECT_EQ(JudgeForces(forces).advice.empty(), verdict == Verdict::kOk);
    forces.reason = client::ForceReason::kStopCall;
    EXPECT_EQ(JudgeForces(forces).advice.empty(), verdict == Verdict::kOk);
    if (verdict == Verdict::kOk) continue;
    EXPECT_EQ(JudgeForces(forces).advice, client::InWords(client::ForceReason::kStopCall));
  }
}

TEST(DeviceList, IsATableWithWhatToDo) {
  std::vector<client::ListedDevice> list;
  EXPECT_EQ(Describe(list), "no devices\n");
  list.push_back({.kind = "simulated",
                  .model = "Simulated Phantom Omni",
                  .usable = true,
                  .verification_level = client::VerificationLevel::kSimulated,
                  .in_use = true});
  list.push_back({.kind = "falcon",
                  .model = "Falcon",
                  .port = "1-2",
                  .problem = "no permission:\njoin the group",
                  .verification_level = client::VerificationLevel::kNone});
  EXPECT_EQ(Describe(list),
            "device     port  verified   state       model\n"
            "simulated  -     simulated  in use      Simulated Phantom Omni\n"
            "falcon     1-2   none       not usable  Falcon\n"
            "  no permission: join the group\n");
}

TEST(WatchView, ShowsForcesThatAreNotOn) {
  WatchStatus status;
  status.pose.emplace();
  const auto live = [&] {
    std::string text;
    for (const std::string& line : LiveView(status, 100, 40)) text += line + "\n";
    return text;
  };
  // An older daemon does not tell.
  EXPECT_FALSE(Has(LogLine(status), "forces"));
  EXPECT_FALSE(Has(live(), "forces"));
  status.pose->forces = Forces(client::ForceState::kOn, client::ForceReason::kNone);
  EXPECT_FALSE(Has(LogLine(status), "forces"));
  EXPECT_FALSE(Has(live(), "forces"));
  status.pose->forces = Forces(client::ForceState::kStopped, client::ForceReason::kStopCall);
  EXPECT_TRUE(Has(LogLine(status), "N, forces stopped (stop call), density")) << LogLine(status);
  EXPECT_TRUE(Has(live(), "forces    stopped: emergency stop")) << live();
}

// A device of which `seconds` were read, all well.
class JudgeTest : public ::testing::Test {
 protected:
  JudgeTest() {
    for (client::DaemonInfo* response : {&before_, &after_}) {
      response->device.verification_level = client::VerificationLevel::kNone;
      response->health.connection = client::DeviceConnection::kStreaming;
      response->servo.rate_hz = 1000.0;
    }
    before_.servo.ticks = 500;
    after_.servo.ticks = 500 + 1990;
    after_.servo.missed_ticks = 10;
    before_.health.readings = 100;
    after_.health.readings = 100 + 1980;
    for (int n = 0; n < 100; ++n) {
      samples_.emplace_back();
      samples_.back().hip_mm = {1e6 + (n % 2) * 0.2, -3.0, 5.0 + n * 1e-3};
    }
  }

  DeviceTestFigures Figures() {
    DeviceTest test(before_);
    for (const client::Pose& sample : samples_) test.Add(sample);
    return test.Figures(after_);
  }
  // The one failure.
  std::string Failure() {
    const DeviceTestFigures figures = Figures();
    EXPECT_EQ(figures.failures.size(), 1u);
    EXPECT_TRUE(Has(Describe(figures), "verdict   failed\n"));
    EXPECT_EQ(ToJson(figures)["passed"], false);
    return figures.failures.empty() ? "" : figures.failures.front();
  }

  client::DaemonInfo before_;
  client::DaemonInfo after_;
  std::vector<client::Pose> samples_;
};

TEST_F(JudgeTest, AGoodDevicePasses) {
  samples_[3].buttons = 1;
  samples_[7].buttons = 4;
  samples_[8].forces.reason = client::ForceReason::kStale;
  const DeviceTestFigures figures = Figures();
  EXPECT_TRUE(figures.failures.empty()) << figures.failures.front();
  EXPECT_DOUBLE_EQ(figures.seconds, 2.0);
  EXPECT_DOUBLE_EQ(figures.ticks_per_s, 995.0);
  EXPECT_DOUBLE_EQ(figures.readings_per_s, 990.0);
  EXPECT_EQ(figures.stale_ticks, 1u);
  EXPECT_TRUE(figures.rested);
  EXPECT_NEAR(figures.range_mm[0], 0.2, 1e-9);
  EXPECT_NEAR(figures.noise_mm[0], 0.1, 1e-9);
  EXPECT_EQ(figures.noise_mm[1], 0.0);
  EXPECT_NEAR(figures.noise_mm[2], 1e-3 * std::sqrt((100.0 * 100.0 - 1.0) / 12.0), 1e-9);
  const std::string text = Describe(figures);
  for (const char* part : {"readings  990.0 per s; 0 lost", "ticks     995.0 per s in 2.0 s",
                           "noise at rest 0.1000", "buttons   0, 2\n", "verdict   passed\n"}) {
    EXPECT_TRUE(Has(text, part)) << part << "\n" << text;
  }
  EXPECT_EQ(ToJson(figures)["buttons"], Json({0, 2}));
}

TEST_F(JudgeTest, AMovedStylusHasNoNoise) {
  samples_[50].hip_mm.y() = 9.0;
  const DeviceTestFigures figures = Figures();
  EXPECT_FALSE(figures.rested);
  EXPECT_EQ(figures.range_mm[1], 12.0);
  EXPECT_TRUE(ToJson(figures)["noise_at_rest_mm"].is_null());
  EXPECT_TRUE(Has(Describe(figures), "not at rest"));
  EXPECT_TRUE(figures.failures.empty());
}

TEST_F(JudgeTest, ADeviceThatIsNotThereFailsWithItsProblem) {
  after_.health.connection = client::DeviceConnection::kAbsent;
  after_.health.problem = "plug it in";
  EXPECT_EQ(Failure(), "the device is not streaming: plug it in");
  after_.health.problem.clear();
  EXPECT_TRUE(Has(Failure(), "palpate device list"));
  std::swap(before_, after_);
  EXPECT_TRUE(Has(Failure(), "not streaming"));
}

TEST_F(JudgeTest, FewReadingsFail) {
  after_.health.readings = 100 + 1799;
  EXPECT_TRUE(Has(Failure(), "900 readings per s")) << Failure();
  after_.health.readings = 100 + 1800;
  EXPECT_TRUE(Figures().failures.empty());
  // A daemon that was started again meanwhile.
  after_.health.readings = 5;
  EXPECT_TRUE(Has(Failure(), "0 readings per s"));
}

TEST_F(JudgeTest, FewTicksFail) {
  after_.servo.ticks = 500 + 1700;
  after_.servo.missed_ticks = 300;
  EXPECT_TRUE(Has(Failure(), "850 ticks per s")) << Failure();
}

TEST_F(JudgeTest, LossesAndCorruptFramesFailAboveOnePercent) {
  after_.health.lost_readings = 20;
  after_.health.corrupt_frames = 20;
  EXPECT_TRUE(Figures().failures.empty());
  after_.health.lost_readings = 21;
  EXPECT_TRUE(Has(Failure(), "1.0 % of the readings are lost")) << Failure();
  after_.health.lost_readings = 0;
  after_.health.corrupt_frames = 21;
  EXPECT_TRUE(Has(Failure(), "frames are corrupt")) << Failure();
}

TEST_F(JudgeTest, ASimulatedDeviceHasNoBus) {
  after_.device.verification_level = client::VerificationLevel::kSimulated;
  after_.health.readings = 0;
  after_.servo.missed_ticks = 1000;
  EXPECT_TRUE(Figures().failures.empty());
  EXPECT_TRUE(Has(Describe(Figures()), "readings  simulated"));
}

TEST_F(JudgeTest, NothingThatCameFails) {
  samples_.clear();
  EXPECT_TRUE(Has(Failure(), "no ticks came"));
  EXPECT_FALSE(Figures().rested);
}

TEST_F(JudgeTest, NoNumberIsNoRest) {
  samples_[9].hip_mm.x() = std::numeric_limits<double>::quiet_NaN();
  samples_[9].hip_mm.y() = std::numeric_limits<double>::infinity();
  const DeviceTestFigures figures = Figures();
  EXPECT_FALSE(figures.rested);
  EXPECT_TRUE(Has(Describe(figures), "not at rest"));
  EXPECT_TRUE(Json::accept(ToText(ToJson(figures))));
}

class CliDeviceTest : public ::testing::Test {
 protected:
  CliDeviceTest() : daemon_((folder_.path() / "palpated.sock").string()) {
    setenv("PALPATE_SOCKET", (folder_.path() / "palpated.sock").c_str(), 1);
  }

  static test::ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {test::kPalpate, "device"});
    return test::Process(arguments).Wait();
  }
  static void ExpectOneError(const test::ProcessResult& result, int exit_code,
                             const std::string& part) {
    EXPECT_EQ(result.exit_code, exit_code) << result.error;
    EXPECT_EQ(result.error.rfind("palpate: ", 0), 0u) << result.error;
    EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1) << result.error;
    EXPECT_TRUE(Has(result.error, part)) << result.error;
  }

  test::TemporaryFolder folder_;
  test::FakeDaemon daemon_;
};

TEST_F(CliDeviceTest, HelpAndWrongUsage) {
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {}, {"list"}, {"info"}, {"calibrate"}, {"enable"}, {"disable"}, {"stop"}, {"test"}}) {
    std::vector<std::string> arguments = command;
    arguments.push_back("--help");
    const test::ProcessResult help = Run(arguments);
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_TRUE(Has(help.output, "Example")) << help.output;
  }
  EXPECT_TRUE(Has(test::Process({test::kPalpate, "--help"}).Wait().output,
                  "Emergency stop: palpate device stop"));
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{},
                                             {"start"},
                                             {"stop", "now"},
                                             {"enable", "a", "b"},
                                             {"list", "x"},
                                             {"test", "--seconds", "0"},
                                             {"test", "--seconds", "-1"},
                                             {"test", "--seconds", "nan"}}) {
    ExpectOneError(Run(arguments), 2, "--help");
  }
}

TEST_F(CliDeviceTest, EnableDisableStop) {
  test::ProcessResult result = Run({"enable"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(result.output, "forces    on\n          at most 3.3 N now\n          since tick 11\n");
  EXPECT_EQ(daemon_.device.enabled_name, "");
  const Json json = Json::parse(Run({"enable", "simulated", "--json"}).output);
  EXPECT_EQ(daemon_.device.enabled_name, "simulated");
  EXPECT_EQ(json["state"], "on");
  EXPECT_EQ(json["applied_tick"], 11);
  result = Run({"stop"});
  EXPECT_TRUE(Has(result.output, "stopped: emergency stop")) << result.output;
  EXPECT_TRUE(Has(result.output, "since tick 13")) << result.output;
  EXPECT_EQ(Json::parse(Run({"stop", "--json"}).output)["reason"], "stop_call");
  EXPECT_EQ(Json::parse(Run({"disable", "--json"}).output)["state"], "off");
}

TEST_F(CliDeviceTest, RefusalsAreOneLine) {
  ExpectOneError(Run({"enable", "other"}), 3, "the daemon's device is `simulated`");
  ExpectOneError(Run({"enable", "broken"}), 10, "forces stay off: plug it in");
}

TEST_F(CliDeviceTest, ListAndInfo) {
  EXPECT_EQ(Run({"list"}).output, "no devices\n");
  EXPECT_EQ(Json::parse(Run({"list", "--json"}).output)["devices"], Json::array());
  v1::ListedDevice& listed = *daemon_.device.list.add_devices();
  listed.set_kind("falcon");
  listed.set_problem("plug it in");
  EXPECT_TRUE(Has(Run({"list"}).output, "  plug it in\n"));
  const Json list = Json::parse(Run({"list", "--json"}).output);
  EXPECT_EQ(list["devices"][0]["kind"], "falcon");
  EXPECT_EQ(list["devices"][0]["usable"], false);
  daemon_.device.level = v1::VERIFICATION_LEVEL_NONE;
  const std::string info = Run({"info"}).output;
  for (const char* part : {"none: nothing of it was seen on hardware", "streaming, calibrated",
                           "forces    on", "force at most 3.3 N"}) {
    EXPECT_TRUE(Has(info, part)) << info;
  }
  const Json json = Json::parse(Run({"info", "--json"}).output);
  EXPECT_EQ(json["device"]["verification_level"], "none");
  EXPECT_EQ(json["health"]["connection"], "streaming");
  EXPECT_EQ(json["forces"]["limit_n"], 3.3);
  EXPECT_EQ(Run({"calibrate"}).output, "health    streaming, calibrated\n");
}

TEST_F(CliDeviceTest, TestPassesAndFails) {
  daemon_.device.level = v1::VERIFICATION_LEVEL_NONE;
  daemon_.device.ticks_per_call = 1000;
  daemon_.device.readings_per_call = 995;
  test::ProcessResult result = Run({"test", "--seconds", "0.2"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_TRUE(Has(result.output, "readings  995.0 per s")) << result.output;
  EXPECT_TRUE(Has(result.output, "verdict   passed")) << result.output;
  daemon_.device.lost_per_call = 100;
  result = Run({"test", "--seconds", "0.2", "--json"});
  ExpectOneError(result, 1, "the device failed its test: 9.1 % of the readings are lost");
  const Json json = Json::parse(result.output);
  EXPECT_EQ(json["passed"], false);
  EXPECT_EQ(json["device"]["kind"], "simulated");
  EXPECT_GT(json["samples"], 0);
}

TEST_F(CliDeviceTest, TestEndsWithTheDaemon) {
  test::Process process({test::kPalpate, "device", "test", "--seconds", "30"});
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  daemon_.Die();
  const test::ProcessResult result = process.Wait();
  EXPECT_EQ(result.exit_code, 8) << result.error;
  EXPECT_EQ(result.output, "");
}

}  // namespace
}  // namespace palpate::cli
