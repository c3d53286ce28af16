// A real palpated with an emulated device: each kind is found, set up, pushes, is lost and is let
// go of, and what the device feels then is asked of the device. device_conformance_test.cpp has
// what each kind promises by itself; the servo's and the service's tests have the states of the
// forces.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/bare_loops.h"
#include "tests/support/daemon.h"
#include "tests/support/falcon_rig.h"
#include "tests/support/forcedimension_rig.h"
#include "tests/support/haply_rig.h"
#include "tests/support/omni_rig.h"
#include "tests/support/places.h"
#include "tests/support/touch_emulator.h"

namespace palpate::test {
namespace {

// A real palpated with a device, for tests that end it in many ways.

// A daemon that is started again and again, with the same socket and state folder.
class DaemonRig {
 public:
  Daemon& daemon() { return *daemon_; }

  // Ends the daemon as a crash does.
  void Kill() {
    EXPECT_NE(daemon_->End(SIGKILL).exit_code, 0);
    daemon_.reset();
  }
  void End() {
    EXPECT_EQ(daemon_->End().exit_code, 0);
    daemon_.reset();
  }

  v1::GetDeviceResponse Get() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    const grpc::Status status = daemon_->device->GetDevice(&context, {}, &response);
    if (!status.ok()) throw std::runtime_error(status.error_message());
    return response;
  }
  grpc::StatusCode Enable(const std::string& name) {
    grpc::ClientContext context;
    v1::EnableForcesRequest request;
    request.set_device(name);
    v1::EnableForcesResponse response;
    return daemon_->device->EnableForces(&context, request, &response).error_code();
  }
  bool WaitForConnection(v1::DeviceConnection connection) {
    return Eventually([&] { return Get().health().connection() == connection; });
  }
  bool WaitForForces(v1::ForceState state) {
    return Eventually([&] { return Get().forces().state() == state; });
  }

 protected:
  void StartOn(const std::vector<std::string>& wrapper, const std::string& device) {
    const std::filesystem::path file = folder_.path() / "device.toml";
    std::ofstream(file) << "[device]\n" << device;
    daemon_ = std::make_unique<Daemon>(
        kPalpated,
        std::vector<std::string>{"--volume", "builtin:sphere:32", "--config", file.string(),
                                 "--socket", folder_.path() / "palpated.sock", "--state-folder",
                                 folder_.path() / "state"},
        wrapper, std::chrono::seconds(550));
  }

  TemporaryFolder folder_;
  std::unique_ptr<Daemon> daemon_;
};

using std::chrono::milliseconds;

// With a device of this kind, and the hand that holds it.
template <class Rig>
class DaemonOf final : public DaemonRig {
 public:
  ~DaemonOf() { daemon_.reset(); }

  void Start() { StartOn(rig.wrapper(), rig.config()); }
  bool TakesReadings(std::uint64_t more) {
    const std::uint64_t before = rig.Tally().readings;
    return Eventually([&] { return rig.Tally().readings >= before + more; });
  }
  // Calibrated, below the sphere.
  void Rest() {
    if (!Get().health().calibrated()) rig.Dock();
    EXPECT_TRUE(Eventually([&] { return Get().health().calibrated(); }));
    rig.Place(rig.kBelow);
    EXPECT_TRUE(TakesReadings(100));
  }
  // Upwards into it until it is so, slower than a hand that is too fast. A slow bus makes the hand
  // slow.
  bool Press(const std::function<bool()>& is_so) {
    for (double y_mm = rig.kBelow.y(); y_mm < 0.0; y_mm += 0.5) {
      rig.Place(Vec3(0.0, y_mm, 0.0));
      if (!TakesReadings(10)) return false;
      if (is_so()) return true;
    }
    return false;
  }
  // Forces are enabled, and come. A machine that stands still for 100 ms makes the device look
  // silent, which ends the forces: then once more.
  bool Pushes() {
    for (int tries = 0; tries < 50; ++tries) {
      Rest();
      // Refused until the fault before is over.
      if (!Eventually([&] { return Enable(rig.kKind) == grpc::StatusCode::OK; })) return false;
      if (Press([&] { return rig.Felt_n().y() < -0.5; })) return true;
    }
    return false;
  }
  // No force comes in any place of a press.
  void ExpectNoForce() {
    const std::uint64_t before = rig.Tally().pushes;
    Rest();
    int places = 0;
    EXPECT_FALSE(Press([&] { return ++places == 0; }));
    EXPECT_EQ(places, std::ceil(-rig.kBelow.y() / 0.5));
    EXPECT_EQ(rig.Tally().pushes, before);
  }

  Rig rig{};
};

template <class Rig>
class DeviceDaemon : public ::testing::Test {};
using Rigs = ::testing::Types<FalconRig, OmegaRig, HaplyRig, OmniRig>;
TYPED_TEST_SUITE(DeviceDaemon, Rigs, RigNames);

TYPED_TEST(DeviceDaemon, UnpluggedOrSilentItIsAFaultAndWaitsForTheOperator) {
  DaemonOf<TypeParam> of;
  of.Start();
  ASSERT_TRUE(of.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  of.ExpectNoForce();
  ASSERT_TRUE(of.Pushes());
  const auto comes_back = [&] {
    EXPECT_TRUE(of.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
    of.ExpectNoForce();
    EXPECT_EQ(of.Get().forces().state(), v1::FORCE_STATE_FAULT);
    EXPECT_TRUE(of.Pushes());
  };
  of.rig.Unplug();
  EXPECT_TRUE(of.WaitForConnection(v1::DEVICE_CONNECTION_ABSENT));
  EXPECT_TRUE(of.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_EQ(of.Get().forces().reason(), v1::FORCE_REASON_DEVICE);
  EXPECT_EQ(of.Enable(of.rig.kKind), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(of.daemon().WaitForTicks(100));  // the loop goes on without it
  of.rig.Plug();
  comes_back();
  of.rig.SetSilent(true);
  EXPECT_TRUE(of.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_TRUE(Eventually([&] { return of.rig.IsLetGoOf(); }));
  of.rig.SetSilent(false);
  comes_back();
}

// The firmware's watchdog brakes the one, and the end of its session ends the other's force.
TYPED_TEST(DeviceDaemon, KilledItLeavesAForceAtMostUntilItIsBackAndThenWaitsForTheOperator) {
  DaemonOf<TypeParam> of;
  of.Start();
  ASSERT_TRUE(of.Pushes());
  of.Kill();
  EXPECT_TRUE(!of.rig.kEndsItsForce || Eventually([&] { return of.rig.Felt_n().isZero(); }));
  of.Start();
  EXPECT_TRUE(of.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  of.ExpectNoForce();
  EXPECT_EQ(of.Get().forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_TRUE(of.Pushes());
}

TYPED_TEST(DeviceDaemon, EndsWithoutForceAndInOrder) {
  DaemonOf<TypeParam> of;
  of.Start();
  ASSERT_TRUE(of.Pushes());
  of.End();
  EXPECT_TRUE(of.rig.Felt_n().isZero());
  of.rig.ExpectLetGoInOrder();
}

template <class Rig>
class StreamedDaemon : public ::testing::Test {};
using StreamedRigs = ::testing::Types<OmegaRig, HaplyRig, OmniRig>;
TYPED_TEST_SUITE(StreamedDaemon, StreamedRigs, RigNames);

// Of ten seconds, the middle one counts: the machine may stop in some. Where it stops in most,
// loops without work miss ticks, too, of what palpated reads by its own timer.
TYPED_TEST(StreamedDaemon, IsReadAndAnsweredAtItsRate) {
  DaemonOf<TypeParam> of;
  of.Start();
  ASSERT_TRUE(of.Pushes());
  std::vector<double> lost, more_than_bare, answered;
  double all = 0.0;
  for (int second = 0; second < 10; ++second) {
    const DeviceTally before = of.rig.Tally();
    const std::uint64_t lost_before = of.Get().health().lost_readings() + before.lost;
    std::optional<BareLoops> bare_loops;
    if (of.rig.kMostLost > 0.0) bare_loops.emplace(std::chrono::microseconds(500));
    std::this_thread::sleep_for(std::chrono::seconds(1));
    if (bare_loops) bare_loops->Stop();
    const DeviceTally after = of.rig.Tally();
    const auto readings = static_cast<double>(after.readings - before.readings);
    all += readings;
    answered.push_back(static_cast<double>(after.forces - before.forces) / readings);
    lost.push_back(
        static_cast<double>(of.Get().health().lost_readings() + after.lost - lost_before));
    more_than_bare.push_back(lost.back() -
                             (bare_loops ? static_cast<double>(bare_loops->most()) : 0.0));
  }
  std::ranges::sort(lost);
  std::ranges::sort(more_than_bare);
  std::ranges::sort(answered);
  std::printf(
      "%.0f readings in 10 s; a second lost %.0f to %.0f, %.0f to %.0f more than bare loops, and"
      " had %.4f to %.4f forces each\n",
      all, lost.front(), lost.back(), more_than_bare.front(), more_than_bare.back(),
      answered.front(), answered.back());
  EXPECT_GT(all, 9.0 * of.rig.kRateHz);
  EXPECT_LE(more_than_bare[5], 0.0);
  // The loops have palpated's timer. Whatever that counts, at most so much may be lost.
  EXPECT_LE(lost[5], of.rig.kMostLost);
  EXPECT_GE(answered[5], 0.99);
}

struct TouchRig : DeviceRig {
  TouchRig() { bus.Plug("1-2", touch); }
  std::vector<std::string> wrapper() const { return bus.wrapper(); }
  std::string config() const { return "kind = \"omni-usb\"\n"; }

  TouchEmulator touch;
  UsbTestbed bus;
};

TEST(TouchDaemon, ATouchIsIdentifiedAndNotDriven) {
  using Kind = UsbEvent::Kind;
  DaemonOf<TouchRig> of;
  const TouchEmulator& touch = of.rig.touch;
  of.Start();
  EXPECT_TRUE(of.daemon().process().WaitFor("EMULATED0001"));
  ASSERT_TRUE(Eventually(
      [&] { return of.Get().health().problem().find("EMULATED0001") != std::string::npos; }));
  EXPECT_EQ(of.Get().device().verification_level(), v1::VERIFICATION_LEVEL_NONE);
  EXPECT_EQ(of.Enable("omni-usb"), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(of.daemon().WaitForTicks(100));  // the loop goes on without it
  of.End();
  ASSERT_TRUE(Eventually([&] { return touch.CountOf(Kind::kClose) > 0; }));
  EXPECT_EQ(touch.CountOf(Kind::kRelease), touch.CountOf(Kind::kClaim));
  EXPECT_EQ(touch.CountOf(Kind::kAttachDriver), touch.CountOf(Kind::kDetachDriver));
  EXPECT_EQ(touch.garbage_bytes(), 0u);
}

// Returns the forces that came after the daemon went on, or was started again.
std::uint64_t ForcesAfter(bool frozen, DaemonOf<OmniRig>& of) {
  EXPECT_TRUE(of.Pushes());
  if (frozen) {
    of.daemon().process().Signal(SIGSTOP);
  } else {
    of.Kill();
  }
  std::this_thread::sleep_for(milliseconds(50));  // what was under way
  const DeviceTally before = of.rig.Tally();
  std::this_thread::sleep_for(milliseconds(100));
  EXPECT_EQ(of.rig.Tally().forces, before.forces);
  EXPECT_FALSE(of.rig.Felt_n().isZero());  // as we assume of a device: nothing ends its force
  if (frozen) {
    of.daemon().process().Signal(SIGCONT);
  } else {
    of.Start();
  }
  EXPECT_TRUE(Eventually(
      [&] { return of.rig.Tally().forces > before.forces && of.rig.Felt_n().isZero(); }));
  EXPECT_TRUE(of.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_TRUE(of.TakesReadings(100));
  EXPECT_NE(of.Get().forces().state(), v1::FORCE_STATE_ON);
  return of.rig.Tally().pushes - before.pushes;
}

TEST(OmniDaemon, FrozenOrKilledUnderItKeepsItsForceUntilSomebodyIsThere) {
  DaemonOf<OmniRig> of;
  of.Start();
  EXPECT_TRUE(of.daemon().process().WaitFor("serial number 70427300007"));
  // The tick and the packet in whose middle it was frozen end first: then once more.
  std::uint64_t forces = 1;
  for (int tries = 0; tries < 10 && forces > 0; ++tries) {
    forces = ForcesAfter(true, of);
    EXPECT_LE(forces, 2u);
  }
  EXPECT_EQ(forces, 0u);
  EXPECT_EQ(ForcesAfter(false, of), 0u);
  EXPECT_EQ(of.Get().forces().state(), v1::FORCE_STATE_OFF);
}

// Thawed: until the operator is there, no force.
template <class Rig>
void ExpectWaiting(DaemonOf<Rig>& of) {
  of.daemon().process().Signal(SIGCONT);
  EXPECT_TRUE(Eventually([&] { return of.rig.Felt_n().isZero(); }));
  EXPECT_TRUE(of.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_TRUE(of.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  of.ExpectNoForce();
  EXPECT_TRUE(of.Pushes());
}

TEST(ForceDimensionDaemon, FrozenItIsBrakedByTheDeviceAndWaitsForTheOperator) {
  DaemonOf<OmegaRig> of;
  of.Start();
  ASSERT_TRUE(of.Pushes());
  of.daemon().process().Signal(SIGSTOP);
  EXPECT_TRUE(Eventually([&] { return of.rig.fake().IsWatchdogTripped(FakeDrdNowNs()); }));
  EXPECT_TRUE(of.rig.Felt_n().isZero());
  EXPECT_NE(of.rig.fake().force[2], 0.0);  // the last command was a force
  ExpectWaiting(of);
}

// How long the service keeps the last force, nobody has published: it is told that nothing comes.
TEST(HaplyDaemon, FrozenItIsSilentAndWaitsForTheOperator) {
  DaemonOf<HaplyRig> of;
  of.Start();
  ASSERT_TRUE(of.Pushes());
  of.daemon().process().Signal(SIGSTOP);
  std::this_thread::sleep_for(milliseconds(300));
  const nlohmann::json report = of.rig.Report();
  EXPECT_GT(report["now_ns"].get<double>() - report["last_message_ns"].get<double>(), 100e6);
  ExpectWaiting(of);
}

}  // namespace

}  // namespace palpate::test
