// A real palpated with an emulated device: each kind is found, set up, pushes, is lost and is let
// go of. usb_device_test.cpp and omni_firewire_test.cpp have the faults; the servo's and the
// service's tests have the states of the forces.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "server/device/falcon/kinematics.h"
#include "tests/support/daemon_rig.h"
#include "tests/support/falcon_emulator.h"
#include "tests/support/firewire_testbed.h"
#include "tests/support/omni_stand.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using Kind = UsbEvent::Kind;

// Declare emulated devices before it: its bus must be destroyed first.
template <class Bus>
class DaemonOn final : public DaemonRig {
 public:
  ~DaemonOn() { daemon_.reset(); }

  Bus& bus() { return bus_; }
  // device: lines for `[device]`.
  void Start(const std::string& device) { StartOn(bus_.wrapper(), device); }

 private:
  Bus bus_;
};
using UsbDaemon = DaemonOn<UsbTestbed>;
using FirewireDaemon = DaemonOn<FirewireTestbed>;

constexpr double kPauseS = 0.4, kPressS = 0.5, kDeepestS = kPauseS + 0.5 * kPressS;

// From `rest` into the sphere above it by 19 mm and back, twice a second, after 0.4 s.
Vec3 Press(const Vec3& rest_mm, double time_s) {
  if (time_s < kPauseS) return rest_mm;
  const double way_mm = 9.5 * (1.0 - std::cos(2.0 * M_PI * (time_s - kPauseS) / kPressS));
  return rest_mm + Vec3(0.0, way_mm, 0.0);
}
// An emulated device moves by a millisecond's way for each force that it got.
constexpr std::size_t kForcesOfAPause = 450, kForcesOfAPress = 600;

// An emulated device, and the hand that holds it.
class HeldDevice {
 public:
  explicit HeldDevice(std::string kind) : kind_(std::move(kind)) {}
  virtual ~HeldDevice() = default;

  // Calibrates it and rests below the sphere; then presses into it.
  virtual void Rest(DaemonRig& daemon) = 0;
  virtual void Press() = 0;
  virtual std::size_t CountFrames() const = 0;
  // Of the frames, those that are not zero.
  virtual std::size_t CountForces() const = 0;

  bool TakesFrames(std::size_t more) const {
    const std::size_t before = CountFrames();
    return Eventually([&] { return CountFrames() >= before + more; });
  }
  // No force comes in any place of a press.
  void ExpectNoForce() {
    const std::size_t before = CountForces();
    Press();
    EXPECT_TRUE(TakesFrames(kForcesOfAPause + kForcesOfAPress));
    EXPECT_EQ(CountForces(), before);
  }
  // Forces are enabled, and come. A machine that stands still for 100 ms makes the device look
  // silent, which ends the forces: then once more.
  bool Pushes(DaemonRig& daemon) {
    for (int tries = 0; tries < 50; ++tries) {
      Rest(daemon);
      const bool rests = Eventually([&] {
        const v1::DeviceHealth health = daemon.Get().health();
        return health.connection() == v1::DEVICE_CONNECTION_STREAMING && health.calibrated();
      });
      Press();
      if (!rests || !TakesFrames(kForcesOfAPause)) return false;
      // Refused until the fault before is over.
      if (!Eventually([&] { return daemon.Enable(kind_) == grpc::StatusCode::OK; })) return false;
      const std::size_t before = CountForces();
      bool pushes = false;
      const bool ended = Eventually([&] {
        pushes = CountForces() > before + 20;
        return pushes || daemon.Get().forces().state() == v1::FORCE_STATE_FAULT;
      });
      if (pushes || !ended) return pushes;
    }
    return false;
  }

 private:
  const std::string kind_;
};

class Falcon final : public HeldDevice {
 public:
  Falcon() : HeldDevice("falcon") {}

  void Rest(DaemonRig&) override {
    emulator.SetPath([](int) { return CountsAt(kRestMm); });
  }
  void Press() override {
    emulator.SetPath([](int frame) { return CountsAt(test::Press(kRestMm, 1e-3 * frame)); });
  }
  std::size_t CountFrames() const override { return emulator.Forces().size(); }
  std::size_t CountForces() const override {
    const auto forces = emulator.Forces();
    return static_cast<std::size_t>(
        std::ranges::count_if(forces, [](const auto& force) { return !IsZero(force); }));
  }
  bool EndsWithZero() const { return IsZero(emulator.Forces().back()); }
  // The daemon ends.
  void ExpectLetGo(UsbDaemon& daemon) {
    daemon.End();
    ASSERT_TRUE(Eventually([&] { return emulator.CountOf(Kind::kClose) > 0; }));
    EXPECT_TRUE(EndsWithZero());
    EXPECT_EQ(emulator.CountOf(Kind::kRelease), emulator.CountOf(Kind::kClaim));
    EXPECT_EQ(emulator.CountOf(Kind::kAttachDriver), emulator.CountOf(Kind::kDetachDriver));
  }
  FalconEmulator emulator;

 private:
  static bool IsZero(const auto& force) { return force.motors == decltype(force.motors){}; }

  static std::array<std::int16_t, 3> CountsAt(const Vec3& p_mm) {
    Vec3 angles_rad;
    EXPECT_TRUE(FalconAnglesAt(p_mm, angles_rad));
    return FalconCountsFromAngles(angles_rad);
  }
  inline static const Vec3 kRestMm{0.0, -47.0, 0.0};
};

class Omni final : public HeldDevice {
 public:
  Omni() : HeldDevice("omni-firewire") {}

  void Rest(DaemonRig& daemon) override {
    if (!daemon.Get().health().calibrated()) {
      emulator.SetHand(OmniStand::Docked());
      EXPECT_TRUE(Eventually([&] { return daemon.Get().health().calibrated(); }));
    }
    emulator.SetHand(OmniStand::At(kRestMm));
  }
  // And stays there.
  void Press() override {
    emulator.SetPath(
        [](int n) { return OmniStand::At(test::Press(kRestMm, std::min(1e-3 * n, kDeepestS))); });
  }
  std::size_t CountFrames() const override { return emulator.Forces().size(); }
  std::size_t CountForces() const override {
    const auto forces = emulator.Forces();
    return static_cast<std::size_t>(std::ranges::count_if(
        forces, [](const auto& force) { return force.force_enabled && force.motors != kNone; }));
  }
  bool IsPushed() const { return emulator.ForceOnHand() != kNone; }
  OmniFirewireEmulator emulator;

 private:
  static constexpr std::array<int, 3> kNone{};
  inline static const Vec3 kRestMm{0.0, -33.0, 0.0};
};

// A file of bytes that an emulated Falcon takes for its firmware.
class Firmware {
 public:
  Firmware() {
    for (std::size_t n = 0; n < bytes_.size(); ++n) bytes_[n] = static_cast<std::uint8_t>(n * 7);
    std::ofstream(file_, std::ios::binary) << std::string(bytes_.begin(), bytes_.end());
  }
  const Bytes& bytes() const { return bytes_; }
  std::string config() const {
    return "kind = \"falcon\"\nfalcon_firmware = \"" + file_.string() + "\"\n";
  }

 private:
  TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "firmware.bin";
  Bytes bytes_ = Bytes(5000);
};

TEST(DeviceDaemon, ATouchIsIdentifiedAndNotDriven) {
  TouchEmulator touch;
  UsbDaemon rig;
  rig.bus().Plug("1-2", touch);
  rig.Start("kind = \"omni-usb\"\n");
  EXPECT_TRUE(rig.daemon().process().WaitFor("EMULATED0001"));
  ASSERT_TRUE(Eventually(
      [&] { return rig.Get().health().problem().find("EMULATED0001") != std::string::npos; }));
  EXPECT_EQ(rig.Get().device().verification_level(), v1::VERIFICATION_LEVEL_NONE);
  EXPECT_EQ(rig.Enable("omni-usb"), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(rig.daemon().WaitForTicks(100));  // the loop goes on without it
  rig.End();
  ASSERT_TRUE(Eventually([&] { return touch.CountOf(Kind::kClose) > 0; }));
  EXPECT_EQ(touch.CountOf(Kind::kRelease), touch.CountOf(Kind::kClaim));
  EXPECT_EQ(touch.CountOf(Kind::kAttachDriver), touch.CountOf(Kind::kDetachDriver));
  EXPECT_EQ(touch.garbage_bytes(), 0u);
}

TEST(DeviceDaemon, AFalconThatWasPulledOutOrADaemonThatWasKilledWaitsForTheOperator) {
  Falcon falcon;
  UsbDaemon rig;
  const Firmware firmware;
  rig.bus().Plug("1-2", falcon.emulator);
  rig.Start(firmware.config());
  ASSERT_TRUE(falcon.Pushes(rig));
  rig.bus().Unplug("1-2");
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_ABSENT));
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_EQ(rig.Get().forces().reason(), v1::FORCE_REASON_DEVICE);
  EXPECT_EQ(rig.Enable("falcon"), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(rig.daemon().WaitForTicks(100));  // the loop goes on without it

  rig.bus().Plug("1-4", falcon.emulator);
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  falcon.ExpectNoForce();
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_FAULT);
  EXPECT_TRUE(falcon.Pushes(rig));

  rig.Kill();
  falcon.Rest(rig);
  rig.Start(firmware.config());
  ASSERT_TRUE(Eventually([&] { return rig.Get().health().calibrated(); }));
  falcon.ExpectNoForce();
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_TRUE(falcon.Pushes(rig));
}

TEST(DeviceDaemon, AFalconGetsItsFirmwarePushesFallsSilentAndIsLetGoOf) {
  Falcon falcon;
  UsbDaemon rig;
  rig.bus().Plug("1-2", falcon.emulator);
  const Firmware firmware;
  rig.Start(firmware.config());
  ASSERT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_EQ(falcon.emulator.firmware(), firmware.bytes());
  falcon.ExpectNoForce();
  EXPECT_TRUE(falcon.Pushes(rig));

  falcon.emulator.SetFaults({.silent = true});
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_TRUE(Eventually([&] { return falcon.EndsWithZero(); }));
  falcon.emulator.SetFaults({});
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_FAULT);
  EXPECT_TRUE(falcon.Pushes(rig));

  falcon.ExpectLetGo(rig);
}

constexpr const char* kOmni =
    "kind = \"omni-firewire\"\nmotor_counts_per_n_mm = [2.0, -3.0, 4.0]\n";

// Returns the forces that came after the daemon went on, or was started again.
std::size_t ForcesAfter(bool frozen, Omni& omni, FirewireDaemon& rig) {
  EXPECT_TRUE(omni.Pushes(rig));
  if (frozen) {
    rig.daemon().process().Signal(SIGSTOP);
  } else {
    rig.Kill();
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(50));  // what was under way
  const std::size_t frames = omni.CountFrames();
  const std::size_t forces = omni.CountForces();
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(omni.CountFrames(), frames);
  EXPECT_TRUE(omni.IsPushed());  // as we assume of a device: nothing ends its force
  if (frozen) {
    rig.daemon().process().Signal(SIGCONT);
  } else {
    rig.Start(kOmni);
  }
  EXPECT_TRUE(Eventually([&] { return omni.CountFrames() > frames && !omni.IsPushed(); }));
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_TRUE(omni.TakesFrames(100));
  EXPECT_NE(rig.Get().forces().state(), v1::FORCE_STATE_ON);
  return omni.CountForces() - forces;
}

TEST(DeviceDaemon, AnOmniThatWasFrozenOrKilledUnderKeepsItsForceUntilSomebodyIsThere) {
  Omni omni;
  FirewireDaemon rig;
  rig.bus().Plug(omni.emulator);
  rig.Start(kOmni);
  ASSERT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_TRUE(rig.daemon().process().WaitFor("serial number 70427300007"));
  omni.Rest(rig);
  omni.ExpectNoForce();
  // The tick and the packet in whose middle it was frozen end first: then once more.
  std::size_t forces = 1;
  for (int tries = 0; tries < 10 && forces > 0; ++tries) {
    forces = ForcesAfter(true, omni, rig);
    EXPECT_LE(forces, 2u);
  }
  EXPECT_EQ(forces, 0u);
  EXPECT_EQ(ForcesAfter(false, omni, rig), 0u);
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_OFF);
}

TEST(DeviceDaemon, AnOmniThatWasPulledOutWaitsForTheOperatorAndIsLetGoOfWithoutForce) {
  using Event = FirewireEvent;
  Omni omni;
  FirewireDaemon rig;
  rig.bus().Plug(omni.emulator);
  rig.Start(kOmni);
  ASSERT_TRUE(omni.Pushes(rig));
  rig.bus().Unplug(omni.emulator);
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_EQ(rig.Get().forces().reason(), v1::FORCE_REASON_DEVICE);
  EXPECT_TRUE(rig.daemon().process().WaitFor("unplugged"));
  EXPECT_EQ(rig.Enable("omni-firewire"), grpc::StatusCode::FAILED_PRECONDITION);
  rig.bus().Plug(omni.emulator);
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  omni.Rest(rig);
  omni.ExpectNoForce();
  EXPECT_TRUE(omni.Pushes(rig));
  rig.End();
  EXPECT_FALSE(omni.IsPushed());
  EXPECT_FALSE(omni.emulator.Forces().back().force_enabled);
  const std::vector<Event> events = omni.emulator.Events();
  const auto last = std::find_if(events.rbegin(), events.rend(), [](const Event& event) {
    return event.kind == Event::Kind::kWrite;
  });
  EXPECT_EQ(last->number, static_cast<std::int64_t>(OmniFirewireEmulator::kControl));
  EXPECT_EQ(last->bytes, Bytes{0});
  EXPECT_GE(last->time_ns, omni.emulator.Forces().back().time_ns);
  EXPECT_EQ(omni.emulator.Mistakes(), (std::map<std::string, int>{}));
}

// The machine may stop in some seconds: the middle one of ten counts.
TEST(DeviceDaemon, AnOmniIsReadAndAnsweredAThousandTimesASecond) {
  Omni omni;
  FirewireDaemon rig;
  rig.bus().Plug(omni.emulator);
  rig.Start(kOmni);
  ASSERT_TRUE(omni.Pushes(rig));
  omni.Rest(rig);
  std::vector<double> lost, answered;
  std::uint64_t packets = 0;
  for (int second = 0; second < 10; ++second) {
    const auto lost_readings = [&] {
      return rig.Get().health().lost_readings() + omni.emulator.Counts().lost;
    };
    const std::uint64_t lost_before = lost_readings(), sent_before = omni.emulator.packets_sent();
    const std::size_t frames_before = omni.CountFrames();
    std::this_thread::sleep_for(std::chrono::seconds(1));
    const auto sent = static_cast<double>(omni.emulator.packets_sent() - sent_before);
    answered.push_back(static_cast<double>(omni.CountFrames() - frames_before) / sent);
    lost.push_back(static_cast<double>(lost_readings() - lost_before));
    packets += static_cast<std::uint64_t>(sent);
  }
  std::ranges::sort(lost);
  std::ranges::sort(answered);
  std::printf("%lu packets in 10 s; a second lost %.0f at most, and had %.4f to %.4f forces each\n",
              static_cast<unsigned long>(packets), lost.back(), answered.front(), answered.back());
  EXPECT_GT(packets, 9000u);
  EXPECT_EQ(lost[5], 0.0);
  EXPECT_GE(answered[5], 0.99);
}

}  // namespace
}  // namespace palpate::test
