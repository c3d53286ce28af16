// Haply's devices over an emulated service in another process: set-up, and each fault.
// device_daemon_test.cpp has the whole daemon, killed and frozen. What the real service and its
// filters do is not shown here.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string>
#include <vector>

#include "tests/support/haply_rig.h"
#include "tests/support/refusal.h"

namespace palpate::test {
namespace haply {

using std::chrono::milliseconds;

class HaplyTest : public ::testing::Test, protected HaplyRig {
 protected:
  bool PushesSoon() { return device_->Streams() && Pushes(); }
  // The device is lost, says why, the last force is zero, and it pushes again once all is well.
  // `hears`: it can be told a zero; else its session ends.
  void ExpectLost(const Json& fault, const std::string& line, const Json& mend, bool hears = true) {
    Set(fault);
    EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kFault; }))
        << fault;
    EXPECT_TRUE(Eventually([&] { return hears ? IsLastZero() : Felt_n().isZero(); })) << fault;
    EXPECT_TRUE(device_->Logs(line)) << fault << device_->log();
    Set(mend);
    EXPECT_TRUE(Pushes()) << fault << device_->log();
    device_->Forget();
  }
};

TEST_F(HaplyTest, ASessionIsSetUpOnceAndEndsWithZeroAndInOrder) {
  Make();
  ASSERT_TRUE(PushesSoon());
  const Json report = Report();
  const Json first = Json::parse(report["first_messages"][0].get<std::string>());
  EXPECT_EQ(first["session"]["configure"]["profile"]["name"], "org.palpate:palpated");
  const Json configure = first["inverse3"][0]["configure"];
  EXPECT_EQ(configure["basis"]["permutation"], "XYZ");
  EXPECT_EQ(configure["damping"]["scalar"], 0.0);
  EXPECT_EQ(configure["mount"]["transform"]["scale"]["x"], 1.0);
  EXPECT_FALSE(configure.contains("preset"));
  for (const char* part : {"inverse3 049D", "firmware 6.2.0", "right-handed", "compensation on",
                           "force gate 0.3", "grip 61F7", "service 3.5"}) {
    EXPECT_NE(device_->health().identity.find(part), std::string::npos) << part;
  }
  EXPECT_EQ(report["sessions_opened"], 1);
  EXPECT_TRUE(device_->log().find("ignores") == std::string::npos) << device_->log();
  (*device_)->Stop();
  ExpectLetGoInOrder();
}

// As an Omni's stylus: -z is where the grip points, x is right, y is up. The grip points along its
// y, which is away from the user at rest.
TEST_F(HaplyTest, TheGripTurnsAsAStylusAndHasButtons) {
  Set({{"needs_probes", true}});
  Make();
  ASSERT_TRUE(device_->Streams());
  const Vec3 right(1, 0, 0), away(0, 1, 0), up(0, 0, 1);
  const struct {
    Vec3 axis, points_M, up_M;
  } turns[] = {{up, -Vec3::UnitX(), Vec3::UnitY()},       // to the user's left
               {-right, -Vec3::UnitY(), -Vec3::UnitZ()},  // down
               {away, -Vec3::UnitZ(), Vec3::UnitX()},     // rolled clockwise
               {Vec3::Zero(), -Vec3::UnitZ(), Vec3::UnitY()}};
  for (const bool pushes : {false, true}) {
    for (const auto& turn : turns) {
      hand_.Turn(turn.axis.isZero() ? 0.0 : M_PI / 2, turn.axis);
      EXPECT_TRUE(device_->Serve(pushes ? kPush : Wrench{}, [&] {
        const Eigen::Quaterniond& R_MS = device_->state().R_MS;
        return (R_MS * -Vec3::UnitZ() - turn.points_M).norm() < 1e-6 &&
               (R_MS * Vec3::UnitY() - turn.up_M).norm() < 1e-6;
      })) << turn.axis.transpose();
    }
  }
  hand_.Press(5);
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return device_->state().buttons == 5; }));
  Set({{"grip", "asleep"}});
  EXPECT_TRUE(device_->Logs("sleeps or is gone"));
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return device_->state().buttons == 0; }));
  Set({{"grip", "none"}});
  Make();
  ASSERT_TRUE(device_->Streams());
  Set({{"grip", "wired"}});  // switched on later
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return device_->state().buttons == 1; }));
}

TEST_F(HaplyTest, EveryGripAndVersionWorks) {
  const Json cases[] = {{{"grip", "none"}},
                        {{"grip", "asleep"}},
                        {{"grip", "wired"}},
                        {{"version", "3.1.0"}},
                        {{"version", nullptr}, {"force_scale", nullptr}},
                        {{"events_refused", true}},
                        {{"fragment", 100}, {"single_bytes", 10}}};
  for (const Json& one : cases) {
    Set(one);
    Make();
    EXPECT_TRUE(PushesSoon()) << one << device_->health().problem;
    device_.reset();
    Set({{"grip", "wireless"},
         {"version", "3.5.2"},
         {"force_scale", 1.0},
         {"events_refused", false}});
  }
}

TEST_F(HaplyTest, AModelThatIsNoneIsRefused) {
  EXPECT_EQ(palpate::testing::Refusal([&] { MakeWith({.model = "inverse"}); }),
            ErrorKind::kInvalidArgument);
}

// Nothing is commanded until it is as it must be.
TEST_F(HaplyTest, WithoutCalibrationOrWithForeignSettingsThereIsNoForce) {
  const Json kScale = {{"x", 2.0}, {"y", 2.0}, {"z", 2.0}};
  const struct {
    Json wrong, right;
    std::string part;
  } cases[] = {
      {{{"status", {{"calibrated", false}}}}, {{"status", {{"calibrated", true}}}}, "calibrate it"},
      {{{"status", {{"ready", false}}}}, {{"status", {{"ready", true}}}}, "not ready"},
      {{{"status", {{"started", false}}}}, {{"status", {{"started", true}}}}, "not started"},
      {{{"status", {{"power_supply", false}}}}, {{"status", {{"power_supply", true}}}}, "power"},
      {{{"transform_scale", 2.0}}, {{"transform_scale", 1.0}}, "another program"},
      {{{"foreign_mount", {{"scale", kScale}}}}, {{"foreign_mount", nullptr}}, "another program"},
      {{{"foreign_mount", {{"position", {{"x", 0.1}, {"y", 0.0}, {"z", 0.0}}}}}},
       {{"foreign_mount", nullptr}},
       "another program"},
      {{{"foreign_mount", {{"rotation", {{"w", 0.0}, {"x", 1.0}, {"y", 0.0}, {"z", 0.0}}}}}},
       {{"foreign_mount", nullptr}},
       "another program"},
      {{{"foreign_basis", "XZY"}}, {{"foreign_basis", nullptr}}, "another program"},
      {{{"foreign_damping", 0.5}}, {{"foreign_damping", nullptr}}, "another program"}};
  Make();
  ASSERT_TRUE(PushesSoon());
  for (const auto& one : cases) {
    Set(one.wrong);
    EXPECT_TRUE(device_->Logs(one.part, kPush)) << one.wrong << device_->log();
    EXPECT_TRUE(device_->HasProblem(one.part));
    EXPECT_TRUE(device_->Serve(kPush, [&] { return Felt_n().isZero(); }));
    const Json before = Report()["counts"]["forces"];
    EXPECT_TRUE(device_->Serve(kPush, [&, n = device_->health().readings] {
      return device_->health().readings > n + 100;
    }));
    EXPECT_EQ(Report()["counts"]["forces"], before);
    Set(one.right);
    EXPECT_TRUE(Pushes()) << one.right;
    device_->Forget();
  }
  // The service's factor on all forces.
  const struct {
    Json scale;
    std::string part;  // "": pushes
  } scales[] = {
      {{{"force_scale", 0.5}}, "force scale to 1"},
      {{{"http_text", {{"/settings/devices/force_scale", "0.5"}}}}, "force scale to 1"},
      {{{"http_text", {{"/settings/devices/force_scale", "1"}}}}, ""},
      {{{"http_text", {{"/settings/devices/force_scale", "{\"value\":2}"}}}}, "scale to 1"},
      {{{"http_text", {{"/settings/devices/force_scale", "[1]"}}}}, "does not tell"}};
  for (const auto& one : scales) {
    device_.reset();
    Set(one.scale);
    const Json forces = Report()["counts"]["forces"];
    Make();
    if (one.part.empty()) {
      EXPECT_TRUE(PushesSoon());
    } else {
      EXPECT_TRUE(device_->Logs(one.part, kPush)) << one.scale;
      EXPECT_EQ(Report()["counts"]["forces"], forces);
    }
    Set({{"force_scale", 1.0}, {"http_text", nullptr}});
  }
}

TEST_F(HaplyTest, AServiceThatDoesNotTellItsVersionIsNotDriven) {
  for (const Json& fault :
       {Json{{"http_silent", true}}, Json{{"http_text", {{"/version", "?"}}}}}) {
    Set(fault);
    Make();
    EXPECT_TRUE(device_->HasProblem("does not tell its version")) << device_->health().problem;
    EXPECT_EQ(Report()["counts"]["forces"], 0);
    Set({{"http_silent", false}, {"http_text", nullptr}});
  }
}

// The texts are those of the next answer that has them: the full state is asked for each second.
TEST_F(HaplyTest, AFullStateThatDoesNotTellItsPlacingMeansNoForce) {
  const std::pair<const char*, const char*> changes[] = {
      {"\"permutation\"", "\"axes\""}, {"\"scalar\"", "\"value\""}, {"\"mount\"", "\"mounting\""}};
  for (const auto& [what, by] : changes) {
    Make();
    ASSERT_TRUE(PushesSoon());
    Set({{"replace", {what, by}}});
    EXPECT_TRUE(device_->Logs("another program", kPush)) << what;
    EXPECT_TRUE(Pushes());
  }
}

TEST_F(HaplyTest, AServiceThatIgnoresForcesIsWarnedOf) {
  Set({{"ignores_forces", true}});
  Make();
  ASSERT_TRUE(device_->Streams());
  EXPECT_TRUE(device_->Logs("ignores our forces", kPush));
}

TEST_F(HaplyTest, LateAndStrangeAnswersAreNoReadings) {
  Make();
  ASSERT_TRUE(PushesSoon());
  asks_too_early_ = true;
  const auto nested = std::string(20'000, '[') + std::string(20'000, ']');
  const auto state = [](const std::string& position) {
    return R"({"inverse3":[{"device_id":"049D","state":{"cursor_position":)" + position + "}}]}";
  };
  // What is strange about others does not matter: only our arm's state does.
  const std::vector<Json> faults = {{{"text", "hello"}},
                                    {{"text", "{\"inverse3\":[{"}},
                                    {{"text", nested}},
                                    {{"text", "{}[]"}},
                                    {{"text", state("[1,2,3]")}},
                                    {{"text", state("{\"x\":1,\"y\":2}")}},
                                    {{"text", state("{\"x\":1e999,\"y\":2,\"z\":3}")}},
                                    {{"text", state("{\"x\":\"1\",\"y\":2,\"z\":3}")}},
                                    {{"text", state("{\"x\":1e306,\"y\":2,\"z\":3}")}},
                                    {{"binary", 1}},
                                    {{"unasked", 1}},
                                    {{"double_replies", 1}}};
  for (const Json& fault : faults) {
    const std::uint64_t before = device_->health().corrupt_frames;
    Set(fault);
    EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->health().corrupt_frames > before; }))
        << fault;
    EXPECT_TRUE(Pushes()) << fault;
    EXPECT_TRUE(device_->state().p_MHip_mm.allFinite());
    EXPECT_LT(device_->state().p_MHip_mm.norm(), 1000.0);
  }
  Set({{"replace", {"\"orientation\": {\"w\": 1.0", "\"orientation\": {\"w\": 0.0"}}});
  EXPECT_TRUE(device_->Logs("sleeps or is gone", kPush));
  EXPECT_TRUE(device_->health().connections == 1) << device_->log();
  Set({{"reply_delay_ms", {{"ms", 3}, {"count", 1}}}, {"ping", 3}});
  EXPECT_TRUE(Pushes());
  ExpectLost({{"reply_delay_ms", {{"ms", 150}, {"count", 1}}}}, "no reading for 100 ms",
             Json::object());
  ExpectLost({{"huge", 1}}, "ended the connection", Json::object(), false);
  // A quick device thread takes them one by one: then they are only corrupt.
  EXPECT_TRUE(Eventually([&] {
    EXPECT_TRUE(Pushes());
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
    Set({{"unasked", 12}});
    device_->Serve(kPush, [&] { return std::chrono::steady_clock::now() > end; });
    return device_->HasLogged("nobody asked for");
  }));
  EXPECT_TRUE(Eventually([&] { return Felt_n().isZero(); }));
  EXPECT_TRUE(Pushes());
  Set({{"events_refused", true}});
  EXPECT_TRUE(device_->Logs("ended its events"));
  Set({{"events_refused", false}});
  EXPECT_TRUE(Pushes());
  device_->Forget();
  service_.Drop();  // the connection and its events, whichever is seen first
  EXPECT_TRUE(device_->Logs("Haply's service ended"));
  EXPECT_TRUE(Pushes());
}

TEST_F(HaplyTest, AForceThatMustEndDoesNotWaitForALateAnswer) {
  Make();
  ASSERT_TRUE(PushesSoon());
  // An answer that is 8 ms late: the zero is there before it, unless this machine stood still.
  const auto is_repeated = [&] {
    const Json before = Report()["zero_repeats"];
    Set({{"reply_delay_ms", {{"ms", 8}, {"count", 1}}}});
    EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() != DeviceStatus::kOk; }));
    EXPECT_TRUE(Pushes());
    return Report()["zero_repeats"] > before;
  };
  EXPECT_TRUE(Eventually(is_repeated));
  EXPECT_LE(Report()["most_unanswered"], 2);
  asks_too_early_ = true;
}

TEST_F(HaplyTest, TheDevicesOwnStopsAreFaultsAndOtherEventsAreLogged) {
  Set({{"second_device", true}});
  MakeWith({.serial = "049D"});
  ASSERT_TRUE(PushesSoon());
  const auto event = [](const char* name, const char* level, const char* safety) {
    return Json{{"name", name},
                {"category", "device"},
                {"level", level},
                {"data", {{"safety_type", safety}}},
                {"message", "as documented"}};
  };
  service_.SendEvent(event("device-battery-low", "warning", ""));
  EXPECT_TRUE(device_->Logs("battery-low", kPush));
  EXPECT_TRUE(Pushes());
  Json other = event("device-safety-triggered", "error", "ebrake_triggered");
  other["data"]["device_id"] = "0B2C";  // another arm's
  service_.SendEvent(other);
  service_.SendEvent({{"name", 7}});
  for (int n = 0; n < 20; ++n) service_.SendEvent(event("device-moved", "info", ""));
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_TRUE(Pushes());
  EXPECT_EQ(device_->health().connections, 1u);
  for (const char* safety : {"ebrake_triggered", "stall_detected"}) {
    Json stop = event("device-safety-triggered", "error", safety);
    stop["message"] = nullptr;
    stop["level"] = 3;
    service_.SendEvent(stop);
    EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kFault; }));
    EXPECT_TRUE(Eventually([&] { return IsLastZero(); }));
    EXPECT_TRUE(device_->Logs(safety)) << device_->log();
    EXPECT_TRUE(Pushes());
  }
}

}  // namespace haply
}  // namespace palpate::test
