// The device over a library of our own: its order of calls, and what it does about the library's
// troubles. openhaptics_frame_test.cpp has the frames. What a real device does is not shown here.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "server/device/openhaptics/hd_library.h"
#include "server/device/openhaptics/openhaptics_device.h"
#include "tests/support/device_conformance.h"
#include "tests/support/device_numbers.h"
#include "tests/support/fake_hd.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/refusal.h"
#include "tests/support/served_device.h"

namespace palpate::test {
namespace {

// A device over an HD library of our own, in this process, and the hand that holds it. The fake
// starts anew with each rig: one at a time.

class OpenHapticsRig : public DeviceRig {
 public:
  static constexpr unsigned int kCommError = 0x0302;
  static constexpr const char *kKind = "openhaptics", *kOwn = "", *kOther = "Right";
  static constexpr const char* kBoth = nullptr;  // the library has a default device
  static constexpr const char *kAbsent = "cannot set up the device", *kLost = "is lost";
  static constexpr const char* kSilent = "stands still";
  static constexpr std::size_t kLinesOfALoss = 2;

  OpenHapticsRig() {
    void* library = dlopen(kFakeHd, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    EXPECT_NE(library, nullptr) << dlerror();
    hd_ = reinterpret_cast<FakeHd::Instance>(dlsym(library, FakeHd::kInstance))();
    Set([](FakeHdRecord& hd) { hd = {}; });
  }
  ~OpenHapticsRig() {
    device_.reset();
    EXPECT_EQ(Get(&FakeHd::breaches), std::vector<std::string>{});
  }

  void Set(const std::function<void(FakeHdRecord&)>& change) {
    const std::lock_guard lock(hd_->mutex);
    change(*hd_);
  }
  template <class Value>
  Value Get(Value FakeHdRecord::*member) {
    const std::lock_guard lock(hd_->mutex);
    return hd_->*member;
  }

  // The device's name in the vendor's set-up stands for a serial number.
  void Make(const std::string& name = "") {
    device_.reset();
    name_ = name;
    device_ = std::make_unique<ServedDevice>(std::make_unique<OpenHapticsDevice>(
        OpenHapticsOptions{.library = kFakeHd, .device_name = name}));
  }
  void Plug() {
    Set([](FakeHdRecord& hd) { hd.init_error = hd.unplugged_error = 0; });
  }
  void Unplug() {
    Set([](FakeHdRecord& hd) { hd.init_error = hd.unplugged_error = kCommError; });
  }
  void PlugOther() {}
  void SetSilent(bool silent) {
    Set([=](FakeHdRecord& hd) { hd.stands_still = silent; });
  }
  void Place(const Vec3& p_mm) {
    Set([&](FakeHdRecord& hd) { hd.position = {p_mm.x(), p_mm.y(), p_mm.z()}; });
  }
  Vec3 Felt_n() { return Vec3(Get(&FakeHd::force).data()); }
  bool IsLetGoOf() { return Feels(Vec3::Zero()) && !Get(&FakeHd::devices)[name_].motors_on; }
  DeviceTally Tally() {
    const std::lock_guard lock(hd_->mutex);
    return {.readings = hd_->frames, .forces = hd_->forces_set, .pushes = hd_->pushes};
  }
  std::uint64_t Touches() { return Get(&FakeHd::frames); }
  bool IsTouched() { return Get(&FakeHd::devices).contains(""); }
  bool IsOtherDriven() { return Get(&FakeHd::devices)[kOther].frames > 0; }
  std::vector<Hindrance> Hindrances() {
    return {{.make = [this] { Unplug(), Make(); },
             .undo = [this] { Plug(); },
             .told = {"HD_COMM_ERROR"}},
            {.make = [this] { Set([](auto& hd) { hd.start_error = 0x0304; }), Make(); },
             .undo = [this] { Set([](auto& hd) { hd.start_error = 0; }); },
             .told = {"HD_TIMER_ERROR"}}};
  }
  bool Feels(const Vec3& force_n) { return (Felt_n() - force_n).norm() < kForceN; }
  bool Pushes() {
    return device_->Serve(kPush, [&] { return Feels(kPush.force_n); });
  }

  FakeHd* hd_ = nullptr;

 private:
  std::string name_{};
};

}  // namespace

INSTANTIATE_TYPED_TEST_SUITE_P(Openhaptics, DeviceConformance, OpenHapticsRig);

}  // namespace palpate::test

namespace palpate {
namespace {

using std::chrono::milliseconds;
using test::Eventually;
using test::kPush;
using testing::Refusal;
using Clock = std::chrono::steady_clock;
using Texts = std::vector<std::string>;

bool HasText(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::string MessageOf(const std::function<void()>& act) {
  try {
    act();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

class OpenHapticsTest : public ::testing::Test, protected test::OpenHapticsRig {
 protected:
  void StartStreaming() {
    Make();
    ASSERT_TRUE(device_->Streams());
  }

  DeviceState state_;
};

TEST_F(OpenHapticsTest, AMissingLibraryOrFunctionIsNamed) {
  OpenHapticsDevice device({.library = "libHD-not-there.so", .device_name = ""});
  const std::string error = MessageOf([&] { device.Start(); });
  EXPECT_TRUE(HasText(error, "libHD-not-there.so")) << error;
  EXPECT_TRUE(HasText(error, "openhaptics_library")) << error;
  device.Stop();
  EXPECT_EQ(device.health().connection, DeviceConnection::kAbsent);
  OpenHapticsDevice other({.library = test::kFakeHdMissing, .device_name = ""});
  EXPECT_TRUE(HasText(MessageOf([&] { other.Start(); }), "hdScheduleAsynchronous"));
}

TEST_F(OpenHapticsTest, ADeviceThatWasNeverStartedIsAtFault) {
  OpenHapticsDevice device({.library = test::kFakeHd, .device_name = ""});
  EXPECT_EQ(device.Read(state_), DeviceStatus::kFault);
  device.Write({{Vec3(1, 0, 0)}}, 0.001);
  device.Stop();
  device.Stop();
  EXPECT_FALSE(device.NextEvent().has_value());
  EXPECT_EQ(Refusal([&] { device.Calibrate(); }), ErrorKind::kUnavailable);
  EXPECT_TRUE(Get(&FakeHd::calls).empty());
  EXPECT_EQ(device.spec().kind, "openhaptics");
  EXPECT_EQ(device.spec().verification_level, VerificationLevel::kNone);
  EXPECT_TRUE(IsHardware(device.spec()));
}

TEST_F(OpenHapticsTest, FramesCarryPosesInAndForcesOut) {
  Set([](FakeHdRecord& hd) {
    hd.counts_in_position = true;
    hd.buttons = 2;
  });
  StartStreaming();
  EXPECT_EQ(Refusal([&] { (*device_)->Start(); }), ErrorKind::kConflict);
  double last_mm = 0.0;
  const DeviceState& state = device_->state();
  ASSERT_TRUE(device_->Serve(kPush, [&] {
    EXPECT_EQ(state.p_MHip_mm.x(), state.p_MHip_mm.y());  // none is torn
    EXPECT_EQ(state.p_MHip_mm.x(), state.p_MHip_mm.z());
    EXPECT_GE(state.p_MHip_mm.x(), last_mm);
    last_mm = state.p_MHip_mm.x();
    return device_->health().readings >= 1000 && Feels(kPush.force_n);
  }));
  EXPECT_EQ(state.buttons, 2u);
  EXPECT_FALSE(state.docked);
  EXPECT_TRUE(state.calibrated);
  const DeviceHealth health = device_->health();
  EXPECT_EQ(health.identity, "Fake Touch, serial number 12345, firmware 1.25");
  EXPECT_EQ(health.corrupt_frames, 0u);
  EXPECT_EQ(health.transfer_errors, 0u);
  EXPECT_EQ(Get(&FakeHd::device_name), "");
}

TEST_F(OpenHapticsTest, TheLimitIsTheLowerOfTheLibrarysAndTheDatasheets) {
  const std::pair<double, double> cases[] = {{2.0, 2.0}, {8.5, 3.3}, {test::kInfinity, 3.3}};
  for (const auto& limits_n : cases) {
    Set([&](FakeHdRecord& hd) { hd.max_force_n = limits_n.first; });
    StartStreaming();
    EXPECT_TRUE(device_->Serve(Wrench{.force_n = Vec3(0, 100, 0)}, [&] {
      return Feels({0, limits_n.second, 0});
    }));
    (*device_)->Stop();
  }
  EXPECT_EQ((*device_)->spec().max_force_n, 3.3);
}

TEST_F(OpenHapticsTest, ADeviceThatComesWithAnErrorIsLetGoOfAndAGarbageHandleIsNone) {
  const auto calls_of = [&](const FakeHdRecord& behaviour) {
    Set([&](FakeHdRecord& hd) { hd = behaviour; });
    Make();
    EXPECT_TRUE(Eventually([&] { return !device_->health().problem.empty(); }));
    (*device_)->Stop();
    return Get(&FakeHd::calls);
  };
  EXPECT_EQ(calls_of({.init_error = 0x0301, .init_gives_handle = true}),
            (Texts{"hdInitDevice", "hdDisableDevice"}));
  EXPECT_EQ(calls_of({.init_handle = 0xdeadbeef}), Texts{"hdInitDevice"});
}

TEST_F(OpenHapticsTest, ALoopThatDoesNotStartIsTakenDownAndTriedAgain) {
  Set([](FakeHdRecord& hd) {
    hd.start_error = 0x0304;
    hd.rate_error = 0x0101;  // no matter
  });
  Make();
  ASSERT_TRUE(device_->HasProblem("HD_TIMER_ERROR"));
  ASSERT_TRUE(Eventually([&] {
    const Texts calls = Get(&FakeHd::calls);
    return calls.size() >= 8 && calls.back() == "hdDisableDevice";
  }));
  Set([](FakeHdRecord& hd) { hd.start_error = 0; });
  ASSERT_TRUE(device_->Streams());
  EXPECT_GE(device_->CountLines("rate"), 1);
}

TEST_F(OpenHapticsTest, FramesThatFailAreCounted) {
  StartStreaming();
  Unplug();
  EXPECT_TRUE(device_->ServeUntil(DeviceStatus::kFault));
  EXPECT_TRUE(Eventually([&] { return device_->health().transfer_errors >= 10; }));
}

TEST_F(OpenHapticsTest, WarmMotorsAreAWarningAndNoFault) {
  const Clock::time_point began = Clock::now();
  StartStreaming();
  for (int i = 0; i < 5; ++i) {
    Set([](FakeHdRecord& hd) { hd.errors = {0x0200}; });
    ASSERT_TRUE(device_->Serve(kPush, [&] { return Get(&FakeHd::errors).empty(); }));
  }
  ASSERT_TRUE(Pushes());
  ASSERT_TRUE(device_->Logs("HD_WARM_MOTORS"));
  EXPECT_LE(device_->CountLines("HD_WARM_MOTORS"),
            1 + (Clock::now() - began) / std::chrono::seconds(10));
  EXPECT_EQ(device_->health().transfer_errors, 0u);
}

TEST_F(OpenHapticsTest, CalibrateWaitsForTheInkwell) {
  StartStreaming();
  (*device_)->Calibrate();
  const std::uint64_t readings = device_->health().readings;
  ASSERT_TRUE(Eventually([&] { return device_->health().readings > readings + 200; }));
  EXPECT_EQ(Get(&FakeHd::calibration_updates), 0u);
  Set([](FakeHdRecord& hd) { hd.inkwell_switch = 0; });
  ASSERT_TRUE(Eventually([&] { return Get(&FakeHd::calibration_updates) == 1; }));
  ASSERT_TRUE(device_->Logs("was calibrated"));
  EXPECT_TRUE(device_->health().docked);
}

// The library acts on its current device and has one stack of errors.
TEST_F(OpenHapticsTest, TwoDevicesHaveEachTheirOwnMotorsForcesAndErrors) {
  const auto link = std::make_shared<HdControl>(test::kFakeHd, Texts{"Left", "Right"}, 3.3);
  link->Start();
  HdServo& left = link->device(0);
  HdServo& right = link->device(1);
  const auto of = [&](const char* name) { return Get(&FakeHd::devices)[name]; };
  bool right_pushes = true;
  DeviceStatus right_status = DeviceStatus::kFault;
  const auto tick = [&](const std::function<bool()>& is_so) {
    return Eventually([&] {
      const bool stale = left.Read(state_) == DeviceStatus::kStale;
      left.seat.Write({{Vec3(stale ? 0.0 : 1.0, 0, 0)}, true});
      right_status = right.Read(state_);
      const double x_n = right_status == DeviceStatus::kStale || !right_pushes ? 0.0 : -2.0;
      right.seat.Write({{Vec3(x_n, 0, 0)}, right_pushes});
      return is_so();
    });
  };
  const auto pushes = [&](const char* name, double x_n) {
    return of(name).motors_on && of(name).force[0] == x_n;
  };
  EXPECT_TRUE(tick([&] { return pushes("Left", 1.0) && pushes("Right", -2.0); }));
  right_pushes = false;
  EXPECT_TRUE(tick([&] { return pushes("Left", 1.0) && !of("Right").motors_on; }));
  right_pushes = true;
  EXPECT_TRUE(tick([&] { return pushes("Right", -2.0); }));
  Set([](FakeHdRecord& hd) { hd.devices["Left"].error = 0x0300; });
  EXPECT_TRUE(tick([&] { return left.lost() && of("Left").force[0] == 0.0; }));
  const std::uint64_t left_frames = of("Left").frames + HdServo::kLostFrames;
  EXPECT_TRUE(tick([&] { return of("Right").frames > left_frames + 100; }));
  EXPECT_TRUE(tick([&] { return pushes("Right", -2.0) && right_status == DeviceStatus::kOk; }));
  EXPECT_LE(of("Left").frames, left_frames);
  EXPECT_TRUE(Eventually([&] { return HasText(link->health(0).problem, "is lost"); }));
  EXPECT_EQ(link->health(1).problem, "");
  // Both are set up again, but not while the right one pushes.
  Set([](FakeHdRecord& hd) { hd.devices["Left"].error = 0; });
  const std::uint64_t inits = Get(&FakeHd::inits);
  const Clock::time_point end = Clock::now() + HdControl::kRetryBeside + milliseconds(200);
  EXPECT_TRUE(tick([&] { return Clock::now() > end; }));
  EXPECT_EQ(Get(&FakeHd::inits), inits);
  right_pushes = false;
  EXPECT_TRUE(tick([&] { return pushes("Left", 1.0); }));
  EXPECT_EQ(Get(&FakeHd::inits), inits + 2);
  EXPECT_TRUE(link->Stop(std::chrono::seconds(60)));
}

TEST_F(OpenHapticsTest, HowToCalibrateDependsOnTheStyle) {
  const auto start = [&](int style) {
    Set([&](FakeHdRecord& hd) {
      hd.calibration_style = style;
      hd.calibration = 0x5002;
    });
    StartStreaming();
  };
  start(4);
  EXPECT_FALSE(device_->health().calibrated);
  EXPECT_TRUE(device_->HasProblem("inkwell"));
  (*device_)->Stop();
  start(1);
  EXPECT_TRUE(device_->HasProblem("reset pose"));
  (*device_)->Stop();
  start(0);
  EXPECT_TRUE(device_->health().calibrated);
  EXPECT_EQ(Refusal([&] { (*device_)->Calibrate(); }), ErrorKind::kInvalidArgument);
}

TEST_F(OpenHapticsTest, StopEndsWithZeroForceAndInOrder) {
  StartStreaming();
  ASSERT_TRUE(Pushes());
  const Clock::time_point began = Clock::now();
  (*device_)->Stop();
  // It waits for frames with zero force, but not for ever.
  EXPECT_TRUE(Get(&FakeHd::zero_frames_at_end) >= 1 || Clock::now() - began >= milliseconds(50));
  Texts calls = Get(&FakeHd::calls);
  // On a busy machine the motors may have been off meanwhile, and the device connected again.
  std::erase_if(calls, [](const auto& call) { return call == "hdEnable" || call == "hdDisable"; });
  ASSERT_GE(calls.size(), 7u);
  calls.erase(calls.begin(), calls.end() - 7);
  EXPECT_EQ(calls,
            (Texts{"hdInitDevice", "hdSetSchedulerRate", "hdScheduleAsynchronous",
                   "hdStartScheduler", "hdStopScheduler", "hdUnschedule", "hdDisableDevice"}));
  const std::uint64_t frames = Get(&FakeHd::frames);
  (*device_)->Write({{Vec3(1, 0, 0)}}, 0.001);
  EXPECT_EQ((*device_)->Read(state_), DeviceStatus::kFault);
  (*device_)->Stop();
  EXPECT_EQ(Get(&FakeHd::frames), frames);
  (*device_)->Start();
  EXPECT_TRUE(Pushes());
}

TEST_F(OpenHapticsTest, ALibraryThatHangsDoesNotHoldStop) {
  StartStreaming();
  ASSERT_TRUE(Pushes());
  Set([](FakeHdRecord& hd) { hd.hangs_in_stop = true; });
  (*device_)->Stop();
  EXPECT_EQ((*device_)->Read(state_), DeviceStatus::kFault);
  EXPECT_EQ(device_->CountLines("does not release the device"), 1);
  (*device_)->Write({{Vec3(1, 0, 0)}}, 0.001);
  EXPECT_TRUE(Eventually([&] { return Feels(Vec3::Zero()); }));
  device_.reset();
  Set([](FakeHdRecord& hd) { hd.hangs_in_stop = false; });
  EXPECT_TRUE(Eventually([&] { return Get(&FakeHd::calls).back() == "hdDisableDevice"; }));
}

TEST(HdErrors, HaveTheirEffectAndUnknownOnesDoNoHarm) {
  EXPECT_EQ(hd::EffectOf(0), hd::ErrorEffect::kNone);
  EXPECT_EQ(hd::EffectOf(0x0200), hd::ErrorEffect::kWarning);
  for (const unsigned int code : {0x0201u, 0x0202u, 0x0203u, 0x0204u}) {
    EXPECT_EQ(hd::EffectOf(code), hd::ErrorEffect::kForce);
  }
  EXPECT_EQ(hd::EffectOf(0x0300), hd::ErrorEffect::kBroken);
  EXPECT_EQ(hd::EffectOf(0x7777), hd::ErrorEffect::kCall);
  EXPECT_TRUE(HasText(hd::Describe({.code = 0x7777}), "0x7777"));
}

}  // namespace

}  // namespace palpate
