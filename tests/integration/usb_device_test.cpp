// UsbDevice against an emulated device in this process, while the device works: readings, forces,
// zero force when the servo is silent, and the end. usb_device_faults_test.cpp has the faults.
//
// The emulation proves behaviour, not timing.
#include "server/device/usb/usb_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "tests/integration/usb_device_support.h"
#include "tests/support/allocation_count.h"
#include "tests/support/excuse.h"
#include "tests/support/plain_stylus.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

TEST(UsbDevice, MotorsHaveNoCurrentUntilTheyMay) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  // Long enough for any slow emulated bus.
  for (int n = 0; n < 300 || (n < 60'000 && stylus.Forces().size() <= 50); ++n) {
    device->Write({1.0, 0.0, 0.0}, 0.001);
    std::this_thread::sleep_for(milliseconds(1));
  }
  device->Stop();
  const std::vector<PlainForce> forces = stylus.Forces();
  EXPECT_GT(forces.size(), 50u);
  EXPECT_TRUE(std::none_of(forces.begin(), forces.end(), IsOn));
}

TEST(UsbDevice, ExchangesReadingsAndForces) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  DeviceState state;
  EXPECT_EQ(device->Read(state), DeviceStatus::kFault);
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));

  const std::vector<DeviceStatus> statuses = Serve(*device, seconds(3), 1.5);
  // The emulation is slow on a busy machine.
  EXPECT_GT(Count(statuses, DeviceStatus::kOk), statuses.size() / 4) << kBusyMachine;
  EXPECT_LT(Count(statuses, DeviceStatus::kFault), statuses.size() / 10) << kBusyMachine;
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  const DeviceHealth health = device->health();
  EXPECT_EQ(health.connections, 1u) << (bus.HaltedSince(0) ? kBusyMachine : "");
  EXPECT_GT(health.readings, 1000u) << kBusyMachine;
  EXPECT_GT(health.forces_written, 100u) << kBusyMachine;
  EXPECT_EQ(health.identity, "serial 7");
  EXPECT_EQ(health.problem, "");
  EXPECT_EQ(LogWithoutHalts(*device), kConnected);
  device->Stop();
  const std::vector<PlainForce> forces = stylus.Forces();
  const auto right = std::count_if(forces.begin(), forces.end(), [](const PlainForce& force) {
    return force.motors_on && force.x_n == 1.5;
  });
  EXPECT_GT(static_cast<std::size_t>(right), forces.size() / 2);
}

TEST(UsbDevice, SetsThePaceOfADeviceThatAnswers) {
  PlainStylus stylus(true);
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice(true);
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  Serve(*device, milliseconds(500), 1.0);
  const DeviceHealth health = device->health();
  EXPECT_GT(health.readings, 50u) << kBusyMachine;
  EXPECT_LE(health.readings, health.forces_written);
  EXPECT_LE(health.forces_written, health.readings + health.readings / 10 + 1);

  // A lost question is asked again.
  stylus.SetMute(true);
  std::this_thread::sleep_for(milliseconds(15));
  stylus.SetMute(false);
  const std::uint64_t readings = device->health().readings;
  EXPECT_TRUE(Eventually([&] { return device->health().readings > readings + 100; }));
  EXPECT_EQ(LogWithoutHalts(*device), kConnected);
}

TEST(UsbDevice, WritesZeroWhenTheServoDoesNot) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return stylus.Forces().size() > 10; }));
  for (const PlainForce& force : stylus.Forces()) {
    EXPECT_FALSE(force.motors_on);  // the servo has not begun
  }
  EXPECT_EQ(device->health().watchdog_zeros, 0u);

  int in_time = 0;  // not counted: a halt of this machine just before the last force
  for (int i = 0; i < 10; ++i) {
    const std::int64_t began_ns = NowNs();
    Serve(*device, milliseconds(100), 2.0);
    const std::int64_t stopped_ns = NowNs();  // a period after the last force
    std::this_thread::sleep_for(milliseconds(100));
    // Off within the 100 ms, or later on a slow emulated bus.
    const bool is_off = !IsOn(stylus.Forces().back());
    EXPECT_TRUE(is_off || bus.HaltedSince(began_ns));
    ASSERT_TRUE(Eventually([&] {
      const PlainForce last = stylus.Forces().back();
      return last.time_ns > stopped_ns && !IsOn(last);
    }));
    const std::vector<PlainForce> forces = stylus.Forces();
    EXPECT_EQ(forces.back().x_n, 0.0);
    const auto off = std::find_if(forces.begin(), forces.end(), [&](const PlainForce& force) {
      return force.time_ns > stopped_ns && !force.motors_on;
    });
    ASSERT_NE(off, forces.end());
    const double after_ms = static_cast<double>(off->time_ns - stopped_ns) * 1e-6;
    const bool is_in_time = after_ms >= UsbDevice::kServoSilentMs - 1 && after_ms < 20.0;
    in_time += is_in_time && std::none_of(off, forces.end(), IsOn) &&
               std::any_of(forces.begin(), off, IsOn);
  }
  EXPECT_GE(in_time, 5) << kBusyMachine;
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  EXPECT_GE(device->health().watchdog_zeros, 10u);
  EXPECT_EQ(LogWithoutHalts(*device), kConnected);
}

// A servo that resumes with its old force would kick the hand.
TEST(UsbDevice, AfterASilenceTheOldForceDoesNotComeBackInOneStep) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  Serve(*device, milliseconds(200), 2.0);
  std::this_thread::sleep_for(milliseconds(50));
  ASSERT_FALSE(stylus.Forces().back().motors_on);
  const std::size_t before = stylus.Forces().size();
  DeviceState state;
  for (int n = 0; n < 200; ++n) {
    device->Write({2.0, 0.0, 0.0}, 0.001);
    std::this_thread::sleep_for(milliseconds(1));
    EXPECT_NE(device->Read(state), DeviceStatus::kOk);
  }
  const std::vector<PlainForce> forces = stylus.Forces();
  EXPECT_GT(forces.size(), before + 20) << kBusyMachine;
  EXPECT_TRUE(
      std::none_of(forces.begin() + static_cast<std::ptrdiff_t>(before), forces.end(), IsOn));
  // After the servo has written zero, its forces are taken again.
  EXPECT_TRUE(Eventually([&] {
    Serve(*device, milliseconds(20), 2.0);
    return stylus.Forces().back().motors_on;
  }));
}

// Returns the number of the thread with this name.
int ThreadNamed(const std::string& name) {
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string its_name;
    std::getline(std::ifstream(task.path() / "comm"), its_name);
    if (its_name == name) return std::stoi(task.path().filename());
  }
  return 0;
}

// Also for corrupt input: the thread that reads the events makes their texts.
TEST(UsbDevice, AllocatesNothingWhileItStreams) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  std::uint64_t corrupt = 0;
  // A halt of the bus makes a new connection, which allocates.
  bool is_judged = false;
  for (int round = 0; round < 30 && !is_judged; ++round) {
    ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
    const std::int64_t began_ns = NowNs();
    const int thread = ThreadNamed("palpate-usb");
    ASSERT_NE(thread, 0);
    test::WatchThread(thread);
    corrupt = device->health().corrupt_frames;
    for (int n = 0; n < 10; ++n) {
      stylus.SetFaults(n % 2 == 0 ? UsbFaults{.corrupt_in = 0} : UsbFaults{});
      Serve(*device, milliseconds(50), 1.0);
    }
    stylus.SetFaults({});
    const std::uint64_t allocations = test::WatchedAllocations();
    test::WatchThread(0);
    corrupt = device->health().corrupt_frames - corrupt;
    is_judged = !bus.HaltedSince(began_ns);
    EXPECT_TRUE(allocations == 0 || !is_judged) << allocations;
  }
  EXPECT_TRUE(is_judged) << kBusyMachine;
  EXPECT_GT(corrupt, 50u) << kBusyMachine;
}

TEST(UsbDevice, StopsInGoodOrder) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  Serve(*device, milliseconds(100), 3.0);
  device->Stop();
  device->Stop();
  DeviceState state;
  EXPECT_EQ(device->Read(state), DeviceStatus::kFault);
  EXPECT_FALSE(stylus.Forces().back().motors_on);
  using Kind = UsbEvent::Kind;
  std::vector<std::pair<Kind, int>> last;
  for (const UsbEvent& event : stylus.Events()) {
    if (event.kind != Kind::kClose) last.emplace_back(event.kind, event.number);
  }
  ASSERT_GT(last.size(), 5u);
  last.erase(last.begin(), last.end() - 5);
  EXPECT_EQ(last, (std::vector<std::pair<Kind, int>>{{Kind::kOut, kPlainOut},
                                                     {Kind::kControl, kPlainEnd},
                                                     {Kind::kRelease, 0},
                                                     {Kind::kRelease, 1},
                                                     {Kind::kAttachDriver, 0}}));
  device->Start();
  EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
}

TEST(UsbDevice, HasNoPlaceOfRest) { EXPECT_THROW(MakeDevice()->Calibrate(), Error); }

}  // namespace
}  // namespace palpate::test
