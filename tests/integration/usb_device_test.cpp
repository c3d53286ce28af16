// UsbDevice against an emulated device in this process: what it does when the device
// answers, stops answering, refuses, is pulled out and put in again.
//
// The emulation proves behaviour, not timing.
#include "server/device/usb/usb_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "tests/support/allocation_count.h"
#include "tests/support/excuse.h"
#include "tests/support/plain_stylus.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

bool Eventually(const std::function<bool()>& is_so, milliseconds patience = seconds(5)) {
  const steady_clock::time_point deadline = steady_clock::now() + patience;
  while (steady_clock::now() < deadline) {
    if (is_so()) return true;
    std::this_thread::sleep_for(milliseconds(1));
  }
  return is_so();
}

std::unique_ptr<UsbDevice> MakeDevice(bool answers = false) {
  return std::make_unique<UsbDevice>(std::make_unique<PlainProtocol>(answers), 0);
}

bool Streams(const UsbDevice& device) {
  return device.health().connection == DeviceConnection::kStreaming;
}

std::vector<std::string> Log(UsbDevice& device) {
  std::vector<std::string> lines;
  while (const std::optional<DeviceEvent> event = device.NextEvent()) lines.push_back(event->text);
  return lines;
}

// Reads and writes once a millisecond, as the servo does; the newest statuses.
std::vector<DeviceStatus> Serve(UsbDevice& device, milliseconds time, double force_x_n) {
  std::vector<DeviceStatus> statuses;
  DeviceState state;
  steady_clock::time_point next = steady_clock::now();
  const steady_clock::time_point end = next + time;
  while (next < end) {
    statuses.push_back(device.Read(state));
    device.SetMotors(true);
    // As the safety stage does after a halt of this machine.
    const bool is_held = statuses.back() == DeviceStatus::kStale;
    device.Write({is_held ? 0.0 : force_x_n, 0.0, 0.0}, 0.001);
    next += milliseconds(1);
    std::this_thread::sleep_until(next);
  }
  return statuses;
}

std::size_t Count(const std::vector<DeviceStatus>& statuses, DeviceStatus status) {
  return static_cast<std::size_t>(std::count(statuses.begin(), statuses.end(), status));
}

bool IsOn(const PlainForce& force) { return force.motors_on; }

bool IsHalt(const std::string& line) {
  return line.starts_with("plain: no reading for") || line.starts_with("plain: no force taken for");
}

// A halt of this machine may look like a device's: such lines and the reconnection after
// them are taken out. Returns how many.
std::uint64_t TakeHalts(std::vector<std::string>& lines) {
  std::uint64_t halts = 0;
  // Before it was first connected there is nothing to be connected again.
  while (!lines.empty() && IsHalt(lines.front())) lines.erase(lines.begin());
  for (std::size_t i = 0; i + 1 < lines.size();) {
    if (!IsHalt(lines[i]) || lines[i + 1].find(": connected") == std::string::npos) {
      ++i;
      continue;
    }
    lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(i),
                lines.begin() + static_cast<std::ptrdiff_t>(i) + 2);
    ++halts;
  }
  return halts;
}

std::vector<std::string> LogWithoutHalts(UsbDevice& device) {
  std::vector<std::string> lines = Log(device);
  TakeHalts(lines);
  return lines;
}

const std::vector<std::string> kConnected = {"plain on USB port 1-1: connected, serial 7"};

TEST(UsbDevice, MotorsHaveNoCurrentUntilTheyMay) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  ASSERT_TRUE(Eventually([&] { return Streams(*device); }));
  // However slow the emulated bus.
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

  // A question that got lost is asked again.
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

  int in_time = 0;  // others: a halt of this machine just before the last force
  for (int i = 0; i < 10; ++i) {
    const std::int64_t began_ns = NowNs();
    Serve(*device, milliseconds(100), 2.0);
    const std::int64_t stopped_ns = NowNs();  // a period after the last force
    std::this_thread::sleep_for(milliseconds(100));
    // Within the 100 ms; however slow the emulated bus, later.
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

// The servo that comes back with its old force would kick the hand.
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
  // Once it has said zero, its forces are taken again.
  EXPECT_TRUE(Eventually([&] {
    Serve(*device, milliseconds(20), 2.0);
    return stylus.Forces().back().motors_on;
  }));
}

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
  // At once; after a halt of the emulated bus when it is tried again.
  EXPECT_TRUE(!IsOn(stylus.Forces().back()) || bus.HaltedSince(0));
  EXPECT_TRUE(Eventually([&] { return !IsOn(stylus.Forces().back()); }));
  EXPECT_EQ(device->health().problem, "no reading for 100 ms; connecting again");
  // It is told once, however often it is tried.
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
  // Where transfers failed for longer, another connection is right.
  const bool was_brief = NowNs() - began_ns < 40'000'000;
  EXPECT_TRUE(Eventually([&] { return device->health().readings > readings + 100; }));
  EXPECT_EQ(LogWithoutHalts(*device), kConnected) << (was_brief ? "" : kBusyMachine);

  stylus.SetBabble(true);
  const std::string problem = "transfers fail: check the cable and the port; connecting again";
  EXPECT_TRUE(Eventually([&] { return device->health().problem == problem; }));
  stylus.SetBabble(false);
  EXPECT_TRUE(Eventually([&] { return Streams(*device); }));
}

// One whose readings come, and which would keep its last force.
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

// The number of the thread with this name.
int ThreadNamed(const std::string& name) {
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string its_name;
    std::getline(std::ifstream(task.path() / "comm"), its_name);
    if (its_name == name) return std::stoi(task.path().filename());
  }
  return 0;
}

// Whatever comes in: what is to be said is said by who asks.
TEST(UsbDevice, AllocatesNothingWhileItStreams) {
  PlainStylus stylus;
  UsbTestbed bus;
  bus.Plug("1-1", stylus);
  const std::unique_ptr<UsbDevice> device = MakeDevice();
  device->Start();
  std::uint64_t corrupt = 0;
  // A halt of the bus makes another connection.
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
  // One, and the halts of this machine.
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

TEST(UsbDevice, HasNoPlaceOfRest) { EXPECT_THROW(MakeDevice()->Calibrate(), Error); }

}  // namespace
}  // namespace palpate::test
