// StreamedDevice on USB against an emulated device in this process: readings, forces, zero force
// when the servo is silent, the end, and what the device may do wrong.
//
// The emulation proves behaviour, not timing: where the machine is busy, the emulated bus may stand
// still, and the device looks silent and is connected again. UsbTimes judges times.
#include "server/device/usb/usb_bus.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/device/stream/device_link.h"
#include "server/device/stream/device_seat.h"
#include "tests/support/allocation_count.h"
#include "tests/support/patience.h"
#include "tests/support/plain_stylus.h"
#include "tests/support/refusal.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

bool IsOn(const PlainForce& force) { return force.motors_on; }

class UsbDeviceTest : public ::testing::Test {
 protected:
  explicit UsbDeviceTest(bool answers = false) : stylus_(answers) {
    device_ = std::make_unique<StreamedDevice>(
        std::make_unique<UsbBus>(std::make_unique<PlainProtocol>(answers)), "palpate-usb", 0);
  }

  void StartStreaming() {
    bus_.Plug("1-1", stylus_);
    device_->Start();
    ASSERT_TRUE(Eventually([&] { return Streams(); }));
  }
  bool Streams() const { return device_->health().connection == DeviceConnection::kStreaming; }
  bool StreamsWell() const { return Streams() && device_->health().problem.empty(); }
  bool HasProblem(const std::string& part) const {
    return device_->health().problem.find(part) != std::string::npos;
  }

  void Tick(double force_x_n) {
    status_ = device_->Read(state_);
    // The safety stage does the same after a halt of this machine.
    const double x_n = status_ == DeviceStatus::kStale ? 0.0 : force_x_n;
    device_->Write({.wrench_M = {Vec3(x_n, 0.0, 0.0)}, .motors_on = true}, 0.001);
  }
  // Reads and writes, as the servo does, until it is so.
  bool Serve(double force_x_n, const std::function<bool()>& is_so) {
    return Eventually([&] {
      Tick(force_x_n);
      return is_so();
    });
  }
  bool ServeUntilOn(double force_x_n) {
    return Serve(force_x_n, [&] {
      const std::vector<PlainForce> forces = stylus_.Forces();
      return !forces.empty() && IsOn(forces.back()) && forces.back().x_n == force_x_n;
    });
  }
  // Pushes, and after `what` pushes on. Returns true if the force ends and stays away; once more
  // if this machine stood still meanwhile, because a silent servo ends it too.
  bool IsHeldAfter(const std::function<void()>& what) {
    for (int tries = 0; tries < 20; ++tries) {
      stylus_.calibrated = true;
      if (!ServeUntilOn(1.0)) return false;
      const DeviceHealth before = device_->health();
      const std::size_t sent = stylus_.Forces().size();
      what();
      Eventually([&] {
        device_->Write({.wrench_M = {Vec3(1.0, 0.0, 0.0)}, .motors_on = true}, 0.001);
        return stylus_.Forces().size() > sent + 100;
      });
      const DeviceHealth after = device_->health();
      if (after.watchdog_zeros == before.watchdog_zeros &&
          after.connections == before.connections && Streams()) {
        return !IsOn(stylus_.Forces().back());
      }
    }
    return false;
  }
  // Reads and writes once a millisecond. Returns all statuses, oldest first.
  std::vector<DeviceStatus> ServeFor(milliseconds time, double force_x_n) {
    std::vector<DeviceStatus> statuses;
    steady_clock::time_point next = steady_clock::now();
    const steady_clock::time_point end = next + time;
    while (next < end) {
      Tick(force_x_n);
      statuses.push_back(status_);
      next += milliseconds(1);
      std::this_thread::sleep_until(next);
    }
    return statuses;
  }

  // The lines of the log since the last call with this part.
  std::size_t TakeLines(const std::string& part) {
    while (const std::optional<DeviceEvent> event = device_->NextEvent()) {
      lines_.push_back(event->text);
    }
    return static_cast<std::size_t>(
        std::erase_if(lines_, [&](const auto& line) { return line.find(part) != line.npos; }));
  }

  PlainStylus stylus_;
  UsbTestbed bus_;
  std::unique_ptr<StreamedDevice> device_;
  DeviceState state_;
  DeviceStatus status_ = DeviceStatus::kOk;

 private:
  std::vector<std::string> lines_;
};

class AnsweringUsbDeviceTest : public UsbDeviceTest {
 protected:
  AnsweringUsbDeviceTest() : UsbDeviceTest(true) {}
};

TEST_F(UsbDeviceTest, ExchangesReadingsAndForces) {
  EXPECT_EQ(device_->Read(state_), DeviceStatus::kFault);
  StartStreaming();
  EXPECT_TRUE(ServeUntilOn(1.5));
  EXPECT_TRUE(Serve(1.5, [&] { return status_ == DeviceStatus::kOk && state_.p_MHip_mm.x() > 0; }));
  EXPECT_TRUE(Serve(1.5, [&] { return device_->health().readings > 500; }));
  EXPECT_TRUE(Eventually([&] { return StreamsWell(); }));
  const DeviceHealth health = device_->health();
  EXPECT_GT(health.forces_written, 50u);
  EXPECT_EQ(health.identity, "serial 7");
  EXPECT_EQ(health.corrupt_frames, 0u);
  EXPECT_GE(TakeLines("1-1: connected, serial 7"), health.connections);
  EXPECT_EQ(testing::Refusal([&] { device_->Calibrate(); }), ErrorKind::kInvalidArgument);
}

TEST_F(AnsweringUsbDeviceTest, IsAskedForEachReadingAndAgainWhereAQuestionIsLost) {
  StartStreaming();
  EXPECT_TRUE(Serve(1.0, [&] { return device_->health().readings > 200; }));
  const DeviceHealth health = device_->health();
  EXPECT_LE(health.readings, health.forces_written);
  bool was_asked_again = false;
  for (int tries = 0; tries < 50 && !was_asked_again; ++tries) {
    ASSERT_TRUE(Eventually([&] { return Streams(); }));
    stylus_.mute = true;
    const std::size_t before = stylus_.Forces().size();
    ASSERT_TRUE(Eventually([&] { return stylus_.Forces().size() > before + 3; }));
    was_asked_again = device_->health().problem.empty();  // and not given up
    stylus_.mute = false;
  }
  EXPECT_TRUE(was_asked_again);
  const std::uint64_t readings = device_->health().readings;
  EXPECT_TRUE(Eventually([&] { return device_->health().readings > readings + 100; }));
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
TEST_F(UsbDeviceTest, AllocatesNothingWhileItStreams) {
  StartStreaming();
  const int thread = ThreadNamed("palpate-usb");
  ASSERT_NE(thread, 0);
  bool is_judged = false;
  for (int round = 0; round < 50 && !is_judged; ++round) {
    ASSERT_TRUE(Eventually([&] { return Streams(); }));
    const DeviceHealth before = device_->health();
    WatchThread(thread);
    for (int n = 0; n < 10; ++n) {
      const DeviceHealth begin = device_->health();
      stylus_.SetFaults(n % 2 == 0 ? UsbFaults{.corrupt_in = 0} : UsbFaults{});
      ASSERT_TRUE(Serve(1.0, [&] {
        const DeviceHealth now = device_->health();
        return now.readings > begin.readings + 10 || now.corrupt_frames > begin.corrupt_frames + 10;
      }));
    }
    const std::uint64_t allocations = WatchedAllocations();
    WatchThread(0);
    // A new connection allocates.
    is_judged = Streams() && device_->health().connections == before.connections;
    EXPECT_TRUE(allocations == 0 || !is_judged) << allocations;
  }
  EXPECT_TRUE(is_judged);
}

TEST_F(UsbDeviceTest, StopsInGoodOrderAndStartsAgain) {
  bus_.Plug("1-1", stylus_);
  bool was_lost = true;  // on a busy machine, just before the end
  for (int tries = 0; tries < 20 && was_lost; ++tries) {
    device_->Start();
    ASSERT_TRUE(ServeUntilOn(3.0));
    device_->Stop();
    was_lost = TakeLines(": no ") > 0;
  }
  device_->Stop();
  EXPECT_EQ(device_->Read(state_), DeviceStatus::kFault);
  EXPECT_FALSE(stylus_.Forces().back().motors_on);
  using Kind = UsbEvent::Kind;
  std::vector<std::pair<Kind, int>> last;
  for (const UsbEvent& event : stylus_.Events()) {
    if (event.kind != Kind::kClose) last.emplace_back(event.kind, event.number);
  }
  ASSERT_GT(last.size(), 5u);
  last.erase(last.begin(), last.end() - 5);
  EXPECT_EQ(last, (std::vector<std::pair<Kind, int>>{{Kind::kOut, kPlainOut},
                                                     {Kind::kControl, kPlainEnd},
                                                     {Kind::kRelease, 0},
                                                     {Kind::kRelease, 1},
                                                     {Kind::kAttachDriver, 0}}));
  device_->Start();
  EXPECT_TRUE(Eventually([&] { return Streams(); }));
  // It does not wait for a device that is dead.
  stylus_.SetFaults({.silent = true, .deaf = true});
  device_->Stop();
}

TEST_F(UsbDeviceTest, IsGivenUpAfterAFaultThatStaysAndConnectedAgain) {
  struct Case {
    const char* name;
    std::function<void()> begin;
    const char* problem;
    bool takes_zero = true;
  };
  const Case cases[] = {
      {"silent", [&] { stylus_.SetFaults({.silent = true}); }, "no reading"},
      {"mute", [&] { stylus_.mute = true; }, "no reading"},
      {"cut", [&] { stylus_.SetFaults({.cut_in_to = 3}); }, "no reading"},
      {"corrupt", [&] { stylus_.SetFaults({.corrupt_in = 0}); }, "no reading"},
      {"stalled in", [&] { stylus_.Stall(kPlainIn, true); }, "stalled"},
      {"stalled out", [&] { stylus_.Stall(kPlainOut, true); }, "stalled", false},
      {"babbling", [&] { stylus_.babbles = true; }, "transfers fail"},
      // The readings come, but the device would keep its last force.
      {"deaf", [&] { stylus_.SetFaults({.deaf = true}); }, "no force taken", false}};
  StartStreaming();
  for (const Case& fault : cases) {
    SCOPED_TRACE(fault.name);
    ASSERT_TRUE(ServeUntilOn(1.0));
    fault.begin();
    EXPECT_TRUE(Serve(1.0, [&] { return HasProblem(fault.problem); }));
    EXPECT_TRUE(Serve(1.0, [&] { return status_ == DeviceStatus::kFault; }));
    if (fault.takes_zero) {
      EXPECT_TRUE(Eventually([&] { return !IsOn(stylus_.Forces().back()); }));
    }
    stylus_.SetFaults({});
    stylus_.mute = false;
    stylus_.babbles = false;
    stylus_.EndStalls();
    ASSERT_TRUE(Eventually([&] { return StreamsWell(); }));
  }
  EXPECT_GE(stylus_.CountOf(UsbEvent::Kind::kClearHalt), 4u);  // tried before
}

TEST_F(UsbDeviceTest, MendsAStalledEndpoint) {
  StartStreaming();
  for (const std::uint8_t endpoint : {kPlainIn, kPlainOut, kPlainIn, kPlainOut, kPlainIn}) {
    const std::size_t mended = stylus_.CountOf(UsbEvent::Kind::kClearHalt);
    stylus_.Stall(endpoint, false);
    ASSERT_TRUE(
        Eventually([&] { return stylus_.CountOf(UsbEvent::Kind::kClearHalt) == mended + 1; }));
    const DeviceHealth health = device_->health();
    EXPECT_TRUE(Eventually([&] {
      const DeviceHealth now = device_->health();
      return now.readings > health.readings + 10 && now.forces_written > health.forces_written + 10;
    }));
  }
  EXPECT_GE(device_->health().transfer_errors, 5u);
  EXPECT_EQ(TakeLines("stall"), 0u);
}

// Zero force was sent meanwhile: what was pushed before may not come back in one step.
TEST_F(UsbDeviceTest, AMendedEndpointIsHeldUntilTheServoHasWrittenZero) {
  StartStreaming();
  EXPECT_TRUE(IsHeldAfter([&] { stylus_.Stall(kPlainIn, false); }));
}

// Its positions may jump.
TEST_F(UsbDeviceTest, ADeviceThatLostItsCalibrationIsHeldUntilTheServoHasWrittenZero) {
  StartStreaming();
  EXPECT_TRUE(IsHeldAfter([&] { stylus_.calibrated = false; }));
}

TEST_F(UsbDeviceTest, GoesOnAfterAFewFailedTransfers) {
  StartStreaming();
  bool went_on = false;
  for (int tries = 0; tries < 50 && !went_on; ++tries) {
    ASSERT_TRUE(Eventually([&] { return Streams(); }));
    TakeLines("transfers fail");
    const std::uint64_t errors = device_->health().transfer_errors;
    stylus_.babbles = true;
    ASSERT_TRUE(Eventually([&] { return device_->health().transfer_errors > errors; }));
    stylus_.babbles = false;
    const std::uint64_t readings = device_->health().readings;
    ASSERT_TRUE(Eventually([&] { return device_->health().readings > readings + 20; }));
    went_on = TakeLines("transfers fail") == 0;  // on a busy machine they fail for longer
  }
  EXPECT_TRUE(went_on);
}

TEST_F(UsbDeviceTest, CorruptFramesAreCountedAndReportedAtMostOnceASecond) {
  StartStreaming();
  const steady_clock::time_point began = steady_clock::now();
  std::size_t reports = 0;
  for (int i = 0; i < 20; ++i) {
    const DeviceHealth before = device_->health();
    stylus_.SetFaults({.corrupt_in = 0});
    ASSERT_TRUE(
        Eventually([&] { return device_->health().corrupt_frames > before.corrupt_frames; }));
    stylus_.SetFaults({});
    // The first good frame shows the gap in the numbers.
    ASSERT_TRUE(Eventually([&] { return device_->health().lost_readings > before.lost_readings; }));
    reports += TakeLines("dropped");
  }
  EXPECT_GE(reports, 1u);
  EXPECT_LE(reports, 2 + (steady_clock::now() - began) / std::chrono::seconds(1));
}

double MedianOf(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// Each of the tries counts for itself: the machine may stop in some.
class UsbTimes : public UsbDeviceTest {};

TEST_F(UsbTimes, KeepsUpWithTheBus) {
  StartStreaming();
  std::vector<double> read, sent;
  for (int half_second = 0; half_second < 8; ++half_second) {
    const DeviceHealth before = device_->health();
    const double brought = -static_cast<double>(stylus_.InTransfers());
    ServeFor(milliseconds(500), 1.0);
    const DeviceHealth after = device_->health();
    const auto readings = static_cast<double>(after.readings - before.readings);
    read.push_back(readings / (brought + static_cast<double>(stylus_.InTransfers())));
    sent.push_back(static_cast<double>(after.forces_written - before.forces_written) / readings);
  }
  std::printf("of what the bus brought read %.3f, forces for each %.3f\n", MedianOf(read),
              MedianOf(sent));
  EXPECT_GT(MedianOf(read), 0.95);
  EXPECT_LT(MedianOf(sent), 1.2);
}

TEST_F(UsbTimes, TheForceEndsSoonAfterTheServo) {
  StartStreaming();
  int in_time = 0;
  for (int i = 0; i < 10; ++i) {
    ServeFor(milliseconds(100), 2.0);
    const std::int64_t stopped_ns = NowNs();  // a period after the last force
    std::this_thread::sleep_for(milliseconds(100));
    const std::vector<PlainForce> forces = stylus_.Forces();
    const auto off = std::find_if(forces.begin(), forces.end(), [&](const PlainForce& force) {
      return force.time_ns > stopped_ns && !force.motors_on;
    });
    if (off == forces.end()) continue;
    const double after_ms = static_cast<double>(off->time_ns - stopped_ns) * 1e-6;
    in_time += after_ms >= DeviceSeat::kServoSilentMs - 1 && after_ms < 20.0 &&
               std::none_of(off, forces.end(), IsOn) && std::any_of(forces.begin(), off, IsOn);
  }
  EXPECT_GE(in_time, 5);
}

TEST_F(UsbTimes, AReadingIsStaleBeforeItIsAFault) {
  StartStreaming();
  int stale_first = 0;
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(Serve(1.0, [&] { return status_ == DeviceStatus::kOk; }));
    stylus_.mute = true;
    const std::vector<DeviceStatus> statuses = ServeFor(milliseconds(300), 1.0);
    stylus_.mute = false;
    stale_first += std::ranges::count(statuses, DeviceStatus::kStale) > 20 &&
                   std::ranges::count(statuses, DeviceStatus::kFault) > 50 &&
                   statuses.back() == DeviceStatus::kFault;
  }
  EXPECT_GE(stale_first, 3);
}

}  // namespace
}  // namespace palpate::test
