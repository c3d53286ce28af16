// The Touch on USB, all of it: protocol, transport and thread against an emulated
// device, whose servo frames are our assumption too. It proves nothing of a real one.
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <thread>

#include "server/device/omni/omni_usb_protocol.h"
#include "server/device/usb/usb_device.h"
#include "tests/support/excuse.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr double kCountsPerNmm = 2.0;

OmniUsbOptions Named() {
  OmniUsbOptions options;
  options.frames = OmniUsbFrames::kFramedFirewire;
  options.state_command = 0x21;
  options.force_command = 0x22;
  options.init_payload.emplace();
  options.motor_counts_per_n_mm = {kCountsPerNmm, kCountsPerNmm, kCountsPerNmm};
  return options;
}

std::unique_ptr<UsbDevice> MakeDevice(const OmniUsbOptions& options) {
  return std::make_unique<UsbDevice>(std::make_unique<OmniUsbProtocol>(options), 0);
}

// Ticks as the servo does until it is so; false: never.
bool Serve(UsbDevice& device, const Vec3& force_D_n, DeviceState& state,
           const std::function<bool()>& is_so) {
  const steady_clock::time_point end = steady_clock::now() + std::chrono::seconds(30);
  while (steady_clock::now() < end) {
    if (device.Read(state) == DeviceStatus::kOk && is_so()) return true;
    // As the safety stage does after a halt of this machine.
    device.Write(device.Read(state) == DeviceStatus::kStale ? Vec3::Zero() : force_D_n, 0.001);
    std::this_thread::sleep_for(milliseconds(1));
  }
  return false;
}

bool HasProblem(const UsbDevice& device, const std::string& part) {
  const steady_clock::time_point end = steady_clock::now() + std::chrono::seconds(30);
  while (steady_clock::now() < end) {
    if (device.health().problem.find(part) != std::string::npos) return true;
    std::this_thread::sleep_for(milliseconds(5));
  }
  return false;
}

TEST(OmniUsbDevice, WithoutNamedFramesItIsIdentifiedAndLeftAlone) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const auto device = MakeDevice({});
  device->Start();
  EXPECT_TRUE(HasProblem(*device,
                         "on USB port 1-2 is serial EMULATED0001, firmware emulated "
                         "1.0; its servo frames over USB are not public"))
      << device->health().problem;
  DeviceState state;
  EXPECT_EQ(device->Read(state), DeviceStatus::kFault);
  device->Stop();
  EXPECT_FALSE(touch.is_streaming());
  EXPECT_TRUE(touch.Forces().empty());
  for (const std::uint8_t command : touch.Commands())
    EXPECT_TRUE(command == 0x0f || command == 0x0c);
  EXPECT_EQ(touch.garbage_bytes(), 0u);
}

// False: the emulated bus stood still, so that the stylus was lost and wants to be docked again;
// not judged.
bool DocksStreamsAndGetsForces() {
  TouchEmulator touch;
  touch.SetDocked(true);
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const auto device = MakeDevice(Named());
  device->Start();
  DeviceState state;
  EXPECT_TRUE(
      Serve(*device, Vec3::Zero(), state, [&] { return state.docked && state.calibrated; }));
  EXPECT_EQ(device->health().identity, "serial EMULATED0001, firmware emulated 1.0");
  EXPECT_LT((state.p_DHip_mm - Vec3(0, -110, -35)).norm(), 1e-9);

  const Vec3 place(30, -20, 10);
  touch.SetPath([=](double) { return place; });
  touch.SetDocked(false);
  touch.SetButtons(true, false);
  const bool is_there = Serve(*device, Vec3::Zero(), state, [&] {
    return !state.docked && (state.p_DHip_mm - place).norm() < 0.1;
  });
  if (bus.HaltedSince(0)) return false;
  EXPECT_TRUE(is_there);
  EXPECT_EQ(state.buttons, 1u);

  const Vec3 force(0.5, -1.0, 0.7);
  OmniJoints joints;
  EXPECT_TRUE(OmniJointsAt(place, joints));
  const Vec3 counts = kCountsPerNmm * OmniTorques_n_mm(joints, force);
  std::size_t before = touch.Forces().size();
  const auto have_come = [&] { return touch.Forces().size() > before + 50; };
  EXPECT_TRUE(Serve(*device, force, state, have_come));
  if (bus.HaltedSince(0)) return false;
  EXPECT_TRUE(touch.Forces().back().IsZero());  // nobody has let the motors on
  EXPECT_FALSE(touch.Forces().back().enabled);
  device->SetMotors(true);
  before = touch.Forces().size();
  EXPECT_TRUE(Serve(*device, force, state, have_come));
  const TouchForce felt = touch.Forces().back();
  if (bus.HaltedSince(0)) return false;
  EXPECT_TRUE(felt.enabled);
  for (int n = 0; n < 3; ++n) EXPECT_NEAR(felt.motors[static_cast<std::size_t>(n)], counts[n], 2.0);

  device->Stop();
  EXPECT_TRUE(touch.Forces().back().IsZero());
  EXPECT_FALSE(touch.Forces().back().enabled);
  EXPECT_FALSE(touch.is_streaming());
  if (bus.HaltedSince(0)) return false;
  EXPECT_EQ(touch.Commands(), (Bytes{0x0f, 0x0c, 0x04, 0x07, 0x07}));
  EXPECT_EQ(touch.garbage_bytes(), 0u);
  return true;
}

TEST(OmniUsbDevice, DockedThenInTheHandItStreamsAndGetsForces) {
  constexpr int kMostTries = 20;
  for (int tries = 1; tries <= kMostTries; ++tries) {
    if (HasFailure() || DocksStreamsAndGetsForces()) return;
  }
  ADD_FAILURE() << "the emulated bus stood still in every try " << kBusyMachine;
}

TEST(OmniUsbDevice, PulledOutAndPutInItHasToBeDockedAgain) {
  TouchEmulator touch;
  touch.SetDocked(true);
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const auto device = MakeDevice(Named());
  device->Start();
  DeviceState state;
  ASSERT_TRUE(Serve(*device, Vec3::Zero(), state, [&] { return state.calibrated; }));
  device->SetMotors(true);
  bus.Unplug("1-2");
  EXPECT_TRUE(HasProblem(*device, "unplugged"));
  touch.SetDocked(false);
  bus.Plug("1-2", touch);
  ASSERT_TRUE(Serve(*device, Vec3(1, 1, 1), state, [&] { return !state.calibrated; }));
  const std::size_t before = touch.Forces().size();
  ASSERT_TRUE(
      Serve(*device, Vec3(1, 1, 1), state, [&] { return touch.Forces().size() > before + 20; }));
  EXPECT_TRUE(touch.Forces().back().IsZero());
  EXPECT_FALSE(touch.Forces().back().enabled);
  touch.SetDocked(true);
  EXPECT_TRUE(Serve(*device, Vec3::Zero(), state, [&] { return state.calibrated; }));
  device->Stop();
}

TEST(OmniUsbDevice, LostAndDamagedFramesAreCountedAndSurvived) {
  TouchEmulator touch;
  touch.SetDocked(true);
  touch.SetLossEvery(10);
  touch.SetBadFrameEvery(7);
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const auto device = MakeDevice(Named());
  device->Start();
  DeviceState state;
  ASSERT_TRUE(Serve(*device, Vec3::Zero(), state, [&] { return device->health().readings > 500; }));
  const DeviceHealth health = device->health();
  const double lost = static_cast<double>(health.lost_readings);
  const double all = static_cast<double>(health.readings) + lost;
  // The emulated device also drops what is not fetched in time.
  EXPECT_GT(lost / all, 1.0 / 10 + 1.0 / 7 - 1.0 / 70 - 0.02);
  EXPECT_EQ(health.connections, 1u) << (bus.HaltedSince(0) ? kBusyMachine : "");
  device->Stop();
}

TEST(OmniUsbDevice, ADeafOneIsNamedWithWhatToDo) {
  TouchEmulator touch;
  touch.SetMute(true);
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const auto device = MakeDevice(Named());
  device->Start();
  EXPECT_TRUE(HasProblem(*device, "unplug it and plug it in again")) << device->health().problem;
  const steady_clock::time_point before = steady_clock::now();
  device->Stop();
  EXPECT_LT(steady_clock::now() - before, std::chrono::seconds(10));
  EXPECT_TRUE(touch.Forces().empty());
}

}  // namespace
}  // namespace palpate::test
