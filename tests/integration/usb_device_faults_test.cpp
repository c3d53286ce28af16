// UsbDevice against an emulated device in this process, when the device fails: it stops answering,
// refuses, sends corrupt frames, is in use by another program, or is pulled out and put in again.
//
// The emulation proves behaviour, not timing.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/device/usb/usb_device.h"
#include "tests/integration/usb_device_support.h"
#include "tests/support/excuse.h"
#include "tests/support/plain_stylus.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

TEST(UsbDevice, LooksForAnUnpluggedDeviceAgain) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
    Serve(*device, milliseconds(100), 1.0);
    bus.Unplug("1-1");
    ASSERT_TRUE(Eventually([&] { return !Streams(*device); }));
    DeviceState state;
    EXPECT_EQ(device->Read(state), DeviceStatus::kFault);
    ASSERT_TRUE(
        Eventually([&] { return device->health().problem == "unplugged; looking for it again"; }));
    if (i == 0) std::this_thread::sleep_for(milliseconds(3 * UsbDevice::kRetryMs));
    bus.Plug("1-1", stylus);
  }
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  EXPECT_EQ(device->health().problem, "");
  const std::string connected = kConnected[0];
  const std::string gone = "plain: unplugged; looking for it again";
  EXPECT_EQ(LogWithoutHalts(*device),
            (std::vector{connected, gone, connected, gone, connected, gone, connected}));
}

TEST(UsbDevice, SaysOnceThatItIsNotFound) {
  PlainStylus stylus;
  UsbTestbed bus;
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  std::this_thread::sleep_for(milliseconds(3 * UsbDevice::kRetryMs));
  EXPECT_EQ(LogWithoutHalts(*device),
            std::vector<std::string>{"plain: not found: plug it in, or see `palpate device list`"});
  EXPECT_EQ(device->health().connection, DeviceConnection::kAbsent);
  bus.Plug("1-1", stylus);
  EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
  EXPECT_EQ(device->health().problem, "");
  EXPECT_EQ(LogWithoutHalts(*device), kConnected);
}

TEST(UsbDevice, GivesASilentDeviceUp) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  Serve(*device, milliseconds(50), 1.0);
  stylus.SetMute(true);
  const std::vector<DeviceStatus> statuses = Serve(*device, milliseconds(300), 1.0);
  EXPECT_GT(Count(statuses, DeviceStatus::kStale), 20u) << kBusyMachine;
  EXPECT_GT(Count(statuses, DeviceStatus::kFault), 50u) << kBusyMachine;
  EXPECT_EQ(statuses.back(), DeviceStatus::kFault);
  ASSERT_FALSE(stylus.Forces().empty());
  // Off at once, or after a halt of the emulated bus.
  EXPECT_TRUE(!IsOn(stylus.Forces().back()) || bus.HaltedSince(0));
  EXPECT_TRUE(Eventually([&] { return !IsOn(stylus.Forces().back()); }));
  EXPECT_EQ(device->health().problem, "no reading for 100 ms; connecting again");
  // The problem is reported once, however often the device is tried.
  std::this_thread::sleep_for(milliseconds(2 * UsbDevice::kRetryMs));
  stylus.SetMute(false);
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  std::vector<std::string> lines = Log(*device);
  ASSERT_GE(lines.size(), 3u);
  EXPECT_EQ(lines[1], "plain: no reading for 100 ms; connecting again");
  EXPECT_GE(TakeHalts(lines), 1u);
  EXPECT_EQ(lines, kConnected);
}

TEST(UsbDevice, MendsAStalledEndpoint) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  for (const std::uint8_t endpoint : {kPlainIn, kPlainOut, kPlainIn, kPlainOut, kPlainIn}) {
    const std::size_t mended = stylus.CountOf(UsbEvent::Kind::kClearHalt);
    stylus.Stall(endpoint, false);
    ASSERT_TRUE(
        Eventually([&] { return stylus.CountOf(UsbEvent::Kind::kClearHalt) == mended + 1; }));
    const DeviceHealth health = device->health();
    EXPECT_TRUE(Eventually([&] {
      const DeviceHealth now = device->health();
      return now.readings > health.readings + 10 && now.forces_written > health.forces_written + 10;
    }));
  }
  const DeviceHealth health = device->health();
  EXPECT_GE(health.transfer_errors, 5u);
  EXPECT_EQ(LogWithoutHalts(*device), kConnected);
}

TEST(UsbDevice, GivesADeviceThatStaysStalledUp) {
  for (const std::uint8_t endpoint : {kPlainIn, kPlainOut}) {
    PlainStylus stylus;
    UsbTestbed bus;
    bus.Plug("1-1", stylus);
    const std::unique_ptr<UsbDevice> device = MakeDevice();
    device->Start();
    ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
    stylus.Stall(endpoint, true);
    const std::string problem = "endpoint stalled 3 times; connecting again";
    ASSERT_TRUE(Eventually([&] { return device->health().problem == problem; }));
    EXPECT_EQ(stylus.CountOf(UsbEvent::Kind::kClearHalt), endpoint == kPlainIn ? 2u : 3u);
    stylus.EndStalls();
    EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
    EXPECT_EQ(LogWithoutHalts(*device),
              (std::vector<std::string>{kConnected[0], "plain: " + problem, kConnected[0]}));
  }
}

TEST(UsbDevice, GoesOnAfterFailedTransfers) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  const std::int64_t began_ns = NowNs();
  stylus.SetBabble(true);
  ASSERT_TRUE(Eventually([&] { return device->health().transfer_errors > 5; }));
  stylus.SetBabble(false);
  const std::uint64_t readings = device->health().readings;
  EXPECT_TRUE(Eventually([&] { return device->health().readings > readings; }));
  // If transfers failed for longer, a new connection is right.
  const bool was_brief = NowNs() - began_ns < 40'000'000;
  EXPECT_TRUE(Eventually([&] { return device->health().readings > readings + 100; }));
  EXPECT_EQ(LogWithoutHalts(*device), kConnected) << (was_brief ? "" : kBusyMachine);

  stylus.SetBabble(true);
  const std::string problem = "transfers fail: check the cable and the port; connecting again";
  EXPECT_TRUE(Eventually([&] { return device->health().problem == problem; }));
  stylus.SetBabble(false);
  EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
}

// The readings come, but the device would keep its last force.
TEST(UsbDevice, GivesADeviceThatTakesNoForceUp) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  stylus.SetFaults({.deaf = true});
  const std::string problem = "no force taken for 100 ms; connecting again";
  ASSERT_TRUE(Eventually([&] { return device->health().problem == problem; }));
  stylus.SetFaults({});
  EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
}

TEST(UsbDevice, CountsCorruptFramesAndReportsThemNowAndThen) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  Log(*device);
  const auto corrupt_some = [&] {
    stylus.SetFaults({.corrupt_in = 0});
    std::this_thread::sleep_for(milliseconds(20));
    stylus.SetFaults({});
    std::this_thread::sleep_for(milliseconds(20));
  };
  for (int i = 0; i < 10; ++i) corrupt_some();
  EXPECT_GT(device->health().corrupt_frames, 50u) << kBusyMachine;
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  EXPECT_EQ(device->health().connections, 1u) << (bus.HaltedSince(0) ? kBusyMachine : "");
  std::vector<std::string> first = Log(*device);
  TakeHalts(first);
  std::erase(first, kConnected[0]);  // after a halt
  ASSERT_EQ(first.size(), 1u);
  EXPECT_NE(first[0].find("dropped"), std::string::npos);
  corrupt_some();
  EXPECT_TRUE(Log(*device).empty()) << kBusyMachine;
  EXPECT_TRUE(Eventually([&] { return !Log(*device).empty(); }));  // a second later
}

TEST(UsbDevice, StopsThoughTheDeviceIsDead) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  stylus.SetFaults({.silent = true, .deaf = true});
  const steady_clock::time_point began = steady_clock::now();
  device->Stop();
  // Stop does not wait for the dead device for long; halts of this machine may add to the time.
  EXPECT_LT(steady_clock::now() - began, seconds(2)) << kBusyMachine;
}

TEST(UsbDevice, SaysWhoElseHasIt) {
  PlainStylus stylus;
  stylus.SetFaults({.busy = true});
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return !device->health().problem.empty(); }));
  EXPECT_NE(device->health().problem.find("another program"), std::string::npos);
  stylus.SetFaults({});
  EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
}

}  // namespace
}  // namespace palpate::test
