// `palpate device` and `palpate doctor`: words, tables, and what judges a device and a daemon.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <string_view>

#include "client/cli/description.h"
#include "client/cli/device_test.h"
#include "client/cli/doctor_daemon.h"
#include "client/cli/output.h"
#include "client/sdk/words.h"
#include "common/contract/enumerations.h"

namespace palpate::cli {
namespace {

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(DeviceWords, EveryReasonHasWordsOfItsOwnOnOneLine) {
  std::set<std::string> words;
  for (int n = 1; n < static_cast<int>(kEnumerators<client::ForceReason>.size()); ++n) {
    const auto reason = static_cast<client::ForceReason>(n);
    const std::string text = InWords(reason);
    EXPECT_EQ(text.empty(), reason == client::ForceReason::kNone) << NameOf(reason);
    EXPECT_FALSE(Has(text, "\n"));
    EXPECT_TRUE(words.insert(text).second) << text;
  }
}

TEST(DeviceWords, EveryLevelIsExplained) {
  for (const std::string_view word : kWords<client::VerificationLevel>) {
    EXPECT_FALSE(InWords(*Named<client::VerificationLevel>(word)).empty()) << word;
  }
}

client::ForceStatus Forces(client::ForceState state,
                           client::ForceReason reason = client::ForceReason::kNone) {
  return {state, reason, 3.3};
}

TEST(DeviceWords, ForcesAreToldWithWhatToDo) {
  EXPECT_EQ(Describe(Forces(client::ForceState::kOn)),
            "forces    on\n          at most 3.3 N now\n");
  const client::ForceStatus docked =
      Forces(client::ForceState::kHeld, client::ForceReason::kDocked);
  EXPECT_EQ(InWords(docked), "held: " + client::InWords(client::ForceReason::kDocked));
  EXPECT_EQ(NameOf(docked), "held (docked)");
  EXPECT_EQ(NameOf(Forces(client::ForceState::kRampIn)), "ramp in");
}

TEST(DeviceWords, ALedHandNamesItsLeader) {
  client::DaemonInfo daemon;
  EXPECT_EQ(DescribeHand(daemon), "");
  EXPECT_TRUE(HandJson(daemon)["led_by"].is_null());
  daemon.hand_led_by = "token ada at ipv4:192.0.2.7:51544";
  EXPECT_TRUE(Has(DescribeHand(daemon), daemon.hand_led_by));
  EXPECT_EQ(HandJson(daemon)["led_by"], daemon.hand_led_by);
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
  for (const char* part : {"streaming, calibrated, docked; serial 7", "12 readings, 3 lost",
                           "problem: evil  [2Jdevice\n"}) {
    EXPECT_TRUE(Has(Describe(health), part)) << part << "\n" << Describe(health);
  }
}

client::ServoDescription Ticked(std::uint64_t ticks, std::uint64_t missed) {
  client::ServoDescription servo;
  servo.ticks = ticks;
  servo.missed_ticks = missed;
  return servo;
}

TEST(DoctorDaemon, TicksAreCountedWhileItLooks) {
  EXPECT_EQ(JudgeTicks(Ticked(1000, 50), Ticked(1300, 50)).verdict, Verdict::kOk);
  EXPECT_EQ(JudgeTicks(Ticked(1000, 50), Ticked(1285, 65)).verdict, Verdict::kOk);
  const Finding late = JudgeTicks(Ticked(1000, 50), Ticked(1284, 66));
  EXPECT_EQ(late.verdict, Verdict::kWarn);
  EXPECT_TRUE(Has(late.text, "284 ") && Has(late.text, "16 missed")) << late.text;
  EXPECT_NE(late.advice, "");
  const Finding stuck = JudgeTicks(Ticked(1000, 50), Ticked(1000, 50));
  EXPECT_EQ(stuck.verdict, Verdict::kFail);
  EXPECT_NE(stuck.advice, "");
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

TEST(DoctorDaemon, OneFaultOfADeviceIsOneFindingWithOneRemedy) {
  const std::vector<Finding> machine = {
      {"haply", Verdict::kFail, "does not run", "start it", "haply"},
      {"usb", Verdict::kFail, "not allowed", "join", "falcon"},
      {"space", Verdict::kOk, "much"}};
  Finding device{"device", Verdict::kFail, "haply, absent", "check its cable"};
  std::vector<Finding> left = machine;
  TakeOver("haply", device, left);
  EXPECT_EQ(device.advice, "start it");
  ASSERT_EQ(left.size(), 2u);
  EXPECT_EQ(left[0].name, "usb");
  // It streams, from a place where the check does not look.
  device = {"device", Verdict::kOk, "haply, streaming"};
  left = machine;
  TakeOver("haply", device, left);
  EXPECT_EQ(device.advice, "");
  EXPECT_EQ(left.size(), 2u);
}

TEST(DoctorDaemon, AKindThatOnlyIdentifiesSendsToTheKindsThatDrive) {
  client::DaemonInfo daemon;
  daemon.device.kind = "omni-usb";
  EXPECT_TRUE(Has(JudgeDevice(daemon).advice, "openhaptics"));
  EXPECT_TRUE(Has(JudgeDevice(daemon).advice, "omni-firewire"));
}

TEST(DoctorDaemon, ForcesThatAreNotOnSayWhatToDo) {
  const std::map<client::ForceState, Verdict> verdicts = {
      {client::ForceState::kOn, Verdict::kOk},        {client::ForceState::kRampIn, Verdict::kOk},
      {client::ForceState::kOff, Verdict::kWarn},     {client::ForceState::kHeld, Verdict::kWarn},
      {client::ForceState::kStopped, Verdict::kWarn}, {client::ForceState::kFault, Verdict::kFail}};
  for (const auto& [state, verdict] : verdicts) {
    const bool is_ok = verdict == Verdict::kOk;
    EXPECT_EQ(JudgeForces(Forces(state)).verdict, verdict) << NameOf(state);
    EXPECT_EQ(JudgeForces(Forces(state)).advice.empty(), is_ok);
    EXPECT_EQ(JudgeForces(Forces(state, client::ForceReason::kStopCall)).advice,
              is_ok ? "" : client::InWords(client::ForceReason::kStopCall));
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

// A device that was read for 2 s, all well.
class DeviceJudgeTest : public ::testing::Test {
 protected:
  struct Reading {
    client::DaemonInfo before, after;
    std::vector<client::Pose> samples;

    DeviceTestFigures Figures() const {
      DeviceTest test(before);
      for (const client::Pose& sample : samples) test.Add(sample);
      return test.Figures(after);
    }
  };

  static Reading Good() {
    Reading good;
    for (client::DaemonInfo* info : {&good.before, &good.after}) {
      info->device.verification_level = client::VerificationLevel::kNone;
      info->health.connection = client::DeviceConnection::kStreaming;
      info->servo.rate_hz = 1000.0;
    }
    good.before.servo.ticks = 500;
    good.after.servo.ticks = 500 + 1990;
    good.after.servo.missed_ticks = 10;
    good.before.health.readings = 100;
    good.after.health.readings = 100 + 1980;
    for (int n = 0; n < 100; ++n) {
      good.samples.emplace_back();
      good.samples.back().hip_mm = {1e6 + (n % 2) * 0.2, -3.0, 5.0 + n * 1e-3};
    }
    return good;
  }
};

TEST_F(DeviceJudgeTest, AGoodDevicePasses) {
  Reading reading = Good();
  reading.samples[3].buttons = 1;
  reading.samples[7].buttons = 4;
  reading.samples[8].forces.reason = client::ForceReason::kStale;
  const DeviceTestFigures figures = reading.Figures();
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

// What is not as in a good reading, and the part of the one failure that names it; "": it passes.
TEST_F(DeviceJudgeTest, WhatIsNotWellFails) {
  using Change = std::function<void(Reading&)>;
  constexpr auto kAbsent = client::DeviceConnection::kAbsent;
  const std::vector<std::pair<Change, std::string>> cases = {
      {[](Reading& r) { r.samples[5].replayed = true; }, "replay"},
      {[](Reading& r) { r.before.health.connection = kAbsent; }, "palpate device list"},
      {[](Reading& r) { r.after.health.connection = kAbsent; }, "palpate device list"},
      {[](Reading& r) {
         r.after.health.connection = kAbsent;
         r.after.health.problem = "plug it in";
       },
       "not streaming: plug it in"},
      {[](Reading& r) { r.after.health.readings = 100 + 1800; }, ""},
      {[](Reading& r) { r.after.health.readings = 100 + 1799; }, "900 readings per s"},
      // A daemon that was started again meanwhile.
      {[](Reading& r) { r.after.health.readings = 5; }, "0 readings per s"},
      {[](Reading& r) {
         r.after.servo.ticks = 500 + 1700;
         r.after.servo.missed_ticks = 300;
       },
       "850 ticks per s"},
      {[](Reading& r) { r.after.health.lost_readings = 20; }, ""},
      {[](Reading& r) { r.after.health.lost_readings = 21; }, "readings are lost"},
      {[](Reading& r) { r.after.health.corrupt_frames = 20; }, ""},
      {[](Reading& r) { r.after.health.corrupt_frames = 21; }, "frames are corrupt"},
      {[](Reading& r) { r.samples.clear(); }, "no ticks came"},
      // A simulated device has no bus.
      {[](Reading& r) {
         r.after.device.verification_level = client::VerificationLevel::kSimulated;
         r.after.health.readings = 0;
         r.after.servo.missed_ticks = 1000;
       },
       ""},
  };
  for (const auto& [change, failure] : cases) {
    Reading reading = Good();
    change(reading);
    const DeviceTestFigures figures = reading.Figures();
    const std::string text = Describe(figures);
    EXPECT_EQ(figures.failures.size(), failure.empty() ? 0u : 1u) << text;
    EXPECT_TRUE(figures.failures.empty() || Has(figures.failures[0], failure)) << text;
    EXPECT_EQ(ToJson(figures)["passed"], failure.empty());
    EXPECT_TRUE(Has(text, failure.empty() ? "passed\n" : "failed\n")) << text;
  }
}

TEST_F(DeviceJudgeTest, AMovedStylusHasNoNoise) {
  Reading reading = Good();
  reading.samples[50].hip_mm.y() = 9.0;
  DeviceTestFigures figures = reading.Figures();
  EXPECT_FALSE(figures.rested);
  EXPECT_EQ(figures.range_mm[1], 12.0);
  EXPECT_TRUE(figures.failures.empty());
  EXPECT_TRUE(ToJson(figures)["noise_at_rest_mm"].is_null());
  EXPECT_TRUE(Has(Describe(figures), "not at rest"));
  reading.samples[9].hip_mm.x() = std::numeric_limits<double>::quiet_NaN();
  reading.samples[9].hip_mm.y() = std::numeric_limits<double>::infinity();
  figures = reading.Figures();
  EXPECT_FALSE(figures.rested);
  EXPECT_TRUE(Json::accept(ToText(ToJson(figures))));
  EXPECT_FALSE(Reading().Figures().rested);
}

}  // namespace
}  // namespace palpate::cli
