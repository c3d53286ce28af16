// A real palpated with an emulated USB device: each kind is found, set up, pushes, is lost and is
// let go of. usb_device_test.cpp has the faults; the servo's and the service's tests have the
// states of the forces. The Touch's servo frames are an assumption (touch_emulator.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "server/device/falcon/kinematics.h"
#include "tests/support/daemon.h"
#include "tests/support/falcon_emulator.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using Kind = UsbEvent::Kind;

// Declare emulated devices before it: its bus must be destroyed first.
class UsbDaemon {
 public:
  UsbTestbed& bus() { return bus_; }
  Daemon& daemon() { return *daemon_; }

  // device: lines for `[device]`. The socket and the state folder stay those of the daemon before.
  void Start(const std::string& device) {
    const std::filesystem::path file = folder_.path() / "device.toml";
    std::ofstream(file) << "[device]\n" << device;
    daemon_ = std::make_unique<Daemon>(
        kPalpated,
        std::vector<std::string>{"--volume", "builtin:sphere:32", "--config", file.string(),
                                 "--socket", folder_.path() / "palpated.sock", "--state-folder",
                                 folder_.path() / "state"},
        bus_.wrapper(), std::chrono::seconds(550));
  }
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

 private:
  TemporaryFolder folder_;
  UsbTestbed bus_;
  std::unique_ptr<Daemon> daemon_;
};

// From `rest` to `below` the sphere within 0.4 s, then into it by 19 mm and back, twice a second.
Vec3 PressFromBelow(const Vec3& rest_mm, const Vec3& below_mm, double time_s) {
  constexpr double kApproachS = 0.4, kPressS = 0.5;
  if (time_s < kApproachS) return rest_mm + time_s / kApproachS * (below_mm - rest_mm);
  const double way_mm = 9.5 * (1.0 - std::cos(2.0 * M_PI * (time_s - kApproachS) / kPressS));
  return below_mm + Vec3(0.0, way_mm, 0.0);
}
// An emulated device moves by a millisecond's way for each force that it got.
constexpr std::size_t kForcesOfAnApproach = 450, kForcesOfAPress = 600;

// What the tests do with an emulated device of any kind.
template <class Emulator>
class Arm {
 public:
  virtual ~Arm() = default;
  virtual std::string name() const = 0;
  virtual void Rest() = 0;   // where it is calibrated
  virtual void Press() = 0;  // from there, into the sphere and back

  std::size_t CountFrames() const { return emulator.Forces().size(); }
  // Of the frames, those that are not zero.
  std::size_t CountForces() const {
    const auto forces = emulator.Forces();
    return static_cast<std::size_t>(
        std::ranges::count_if(forces, [](const auto& force) { return !IsZero(force); }));
  }
  bool EndsWithZero() const { return IsZero(emulator.Forces().back()); }
  bool TakesFrames(std::size_t more) const {
    const std::size_t before = CountFrames();
    return Eventually([&] { return CountFrames() >= before + more; });
  }
  // No force comes in any place of a press.
  void ExpectNoForce() {
    const std::size_t before = CountForces();
    Press();
    EXPECT_TRUE(TakesFrames(kForcesOfAnApproach + kForcesOfAPress));
    EXPECT_EQ(CountForces(), before);
  }
  // Forces are enabled, and come. A machine that stands still for 100 ms makes the device look
  // silent, which ends the forces: then once more.
  bool Pushes(UsbDaemon& daemon) {
    for (int tries = 0; tries < 50; ++tries) {
      Rest();
      const bool rests = Eventually([&] {
        const v1::DeviceHealth health = daemon.Get().health();
        return health.connection() == v1::DEVICE_CONNECTION_STREAMING && health.calibrated();
      });
      Press();
      if (!rests || !TakesFrames(kForcesOfAnApproach)) return false;
      // Refused until the fault before is over.
      if (!Eventually([&] { return daemon.Enable(name()) == grpc::StatusCode::OK; })) return false;
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
  // The daemon ends.
  void ExpectLetGo(UsbDaemon& daemon) {
    daemon.End();
    ASSERT_TRUE(Eventually([&] { return emulator.CountOf(Kind::kClose) > 0; }));
    EXPECT_TRUE(EndsWithZero());
    EXPECT_EQ(emulator.CountOf(Kind::kRelease), emulator.CountOf(Kind::kClaim));
    EXPECT_EQ(emulator.CountOf(Kind::kAttachDriver), emulator.CountOf(Kind::kDetachDriver));
  }
  Emulator emulator;

 private:
  static bool IsZero(const auto& force) { return force.motors == decltype(force.motors){}; }
};

class Touch final : public Arm<TouchEmulator> {
 public:
  // The gains are arbitrary, because no real ones are public.
  static std::string Config() {
    std::string zeros = "0";
    for (int n = 1; n < 60; ++n) zeros += ", 0";
    return "kind = \"omni-usb\"\nframes = \"framed-firewire\"\nstate_command = 0x21\n"
           "force_command = 0x22\nmotor_counts_per_n_mm = [4.0, 4.0, 4.0]\ninit_payload = [" +
           zeros + "]\n";
  }
  Touch() { emulator.waits_for_forces = true; }
  std::string name() const override { return "omni-usb"; }
  void Rest() override {
    emulator.SetPath([](double) { return kRestMm; });
    emulator.docked = true;
  }
  void Press() override {
    emulator.docked = false;
    emulator.SetPath(
        [](double time_s) { return PressFromBelow(kRestMm, Vec3(0.0, -36.0, 0.0), time_s); });
  }

 private:
  inline static const Vec3 kRestMm{0.0, -110.0, -35.0};
};

class Falcon final : public Arm<FalconEmulator> {
 public:
  std::string name() const override { return "falcon"; }
  void Rest() override {
    emulator.SetPath([](int) { return CountsAt(kRestMm); });
  }
  void Press() override {
    emulator.SetPath(
        [](int frame) { return CountsAt(PressFromBelow(kRestMm, kRestMm, 1e-3 * frame)); });
  }

 private:
  static std::array<std::int16_t, 3> CountsAt(const Vec3& p_mm) {
    Vec3 angles_rad;
    EXPECT_TRUE(FalconAnglesAt(p_mm, angles_rad));
    return FalconCountsFromAngles(angles_rad);
  }
  inline static const Vec3 kRestMm{0.0, -47.0, 0.0};
};

TEST(DeviceDaemon, ATouchIsIdentifiedPushesWhenEnabledAndIsLetGoOf) {
  Touch touch;
  UsbDaemon rig;
  rig.bus().Plug("1-2", touch.emulator);
  touch.Rest();
  rig.Start(Touch::Config());
  ASSERT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  const v1::GetDeviceResponse device = rig.Get();
  EXPECT_EQ(device.device().kind(), "omni-usb");
  EXPECT_EQ(device.device().verification_level(), v1::VERIFICATION_LEVEL_NONE);
  EXPECT_NE(device.health().identity().find("EMULATED0001"), std::string::npos);
  EXPECT_TRUE(rig.daemon().process().WaitFor("EMULATED0001"));
  touch.ExpectNoForce();
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_TRUE(touch.Pushes(rig));

  touch.ExpectLetGo(rig);
  EXPECT_FALSE(touch.emulator.Forces().back().enabled);
  EXPECT_FALSE(touch.emulator.is_streaming());
  EXPECT_EQ(touch.emulator.garbage_bytes(), 0u);
}

TEST(DeviceDaemon, ATouchThatWasPulledOutOrADaemonThatWasKilledWaitsForTheOperator) {
  Touch touch;
  UsbDaemon rig;
  rig.bus().Plug("1-2", touch.emulator);
  rig.Start(Touch::Config());
  ASSERT_TRUE(touch.Pushes(rig));
  rig.bus().Unplug("1-2");
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_ABSENT));
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_EQ(rig.Get().forces().reason(), v1::FORCE_REASON_DEVICE);
  EXPECT_EQ(rig.Enable("omni-usb"), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(rig.daemon().WaitForTicks(100));  // the loop goes on without it

  rig.bus().Plug("1-4", touch.emulator);
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  touch.ExpectNoForce();
  // Its position has no meaning until it was in its holder.
  EXPECT_FALSE(rig.Get().health().calibrated());
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_FAULT);
  EXPECT_TRUE(touch.Pushes(rig));

  rig.Kill();
  touch.Rest();
  rig.Start(Touch::Config());
  ASSERT_TRUE(Eventually([&] { return rig.Get().health().calibrated(); }));
  touch.ExpectNoForce();
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_TRUE(touch.Pushes(rig));
}

TEST(DeviceDaemon, AFalconGetsItsFirmwarePushesFallsSilentAndIsLetGoOf) {
  Falcon falcon;
  UsbDaemon rig;
  rig.bus().Plug("1-2", falcon.emulator);
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "firmware.bin";
  Bytes firmware(5000);
  for (std::size_t n = 0; n < firmware.size(); ++n) firmware[n] = static_cast<std::uint8_t>(n * 7);
  std::ofstream(file, std::ios::binary) << std::string(firmware.begin(), firmware.end());
  rig.Start("kind = \"falcon\"\nfalcon_firmware = \"" + file.string() + "\"\n");
  ASSERT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_EQ(falcon.emulator.firmware(), firmware);
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

}  // namespace
}  // namespace palpate::test
