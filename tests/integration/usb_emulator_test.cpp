// The emulated USB devices, as an ordinary libusb program sees them.
#include <gtest/gtest.h>

#include <thread>

#include "tests/support/excuse.h"
#include "tests/support/falcon_emulator.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using Kind = UsbEvent::Kind;
using std::chrono::milliseconds;

std::vector<std::string> Client(const UsbTestbed& bus, std::vector<std::string> arguments,
                                bool bound_by_modes = false) {
  std::vector<std::string> command = bus.wrapper(bound_by_modes);
  command.push_back(test::kUsbClientChild);
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Waits until `condition`, for seconds.
template <class Condition>
bool Eventually(Condition condition) {
  for (int n = 0; n < 500; ++n) {
    if (condition()) return true;
    std::this_thread::sleep_for(milliseconds(10));
  }
  return false;
}

TEST(UsbEmulator, IsEnumeratedWithItsPort) {
  TouchEmulator touch;
  FalconEmulator falcon(true);
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  bus.Plug("1-3", falcon);
  const ProcessResult result = Process(Client(bus, {"list"})).Wait();
  EXPECT_EQ(result.exit_code, 0) << result.output << result.error;
  EXPECT_TRUE(Contains(result.output, "1-2 2988:0302\n")) << result.output;
  EXPECT_TRUE(Contains(result.output, "1-3 0403:cb48\n")) << result.output;
  EXPECT_TRUE(touch.Events().empty());  // nobody opened it
}

TEST(UsbEmulator, ArrivalsAndDeparturesAreHeard) {
  TouchEmulator touch;
  UsbTestbed bus;
  Process client(Client(bus, {"watch"}));
  ASSERT_TRUE(client.WaitFor("watching"));
  bus.Plug("1-2", touch);
  ASSERT_TRUE(client.WaitFor("arrived 1-2 2988:0302"));
  bus.Unplug("1-2");
  ASSERT_TRUE(client.WaitFor("left 1-2 2988:0302"));
  bus.Plug("1-4", touch);
  ASSERT_TRUE(client.WaitFor("arrived 1-4 2988:0302"));
}

TEST(UsbEmulator, ExchangesStatesAndForces) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const ProcessResult result = Process(Client(bus, {"touch", "1000"})).Wait();
  EXPECT_EQ(result.exit_code, 0) << result.output << result.error;
  EXPECT_TRUE(Contains(result.output, "firmware emulated 1.0")) << result.output;
  EXPECT_TRUE(Contains(result.output, "serial EMULATED0001")) << result.output;
  RecordProperty("client", result.output);
  // A force per state, unless the last force was still on its way.
  const std::vector<TouchForce> forces = touch.Forces();
  EXPECT_GT(forces.size(), 900u) << kBusyMachine;
  EXPECT_LE(forces.size(), 1000u);
  for (const TouchForce& force : forces) {
    ASSERT_TRUE(force.IsZero());
    ASSERT_FALSE(force.enabled);
  }
  EXPECT_EQ(touch.garbage_bytes(), 0u);
  EXPECT_EQ(touch.Commands(), (Bytes{0x0f, 0x0c, 0x07}));
}

TEST(UsbEmulator, KnowsWhoHoldsItsInterfaces) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const ProcessResult result = Process(Client(bus, {"touch", "10"})).Wait();
  EXPECT_EQ(result.exit_code, 0) << result.output << result.error;
  ASSERT_TRUE(Eventually([&] { return touch.CountOf(Kind::kClose) == 1; }));
  std::vector<Kind> kinds;
  for (const UsbEvent& event : touch.Events()) {
    if (event.kind != Kind::kOut && event.kind != Kind::kControl) kinds.push_back(event.kind);
  }
  // The kernel's driver has both interfaces: it leaves both, and takes both again only
  // when both are free.
  EXPECT_EQ(kinds,
            (std::vector<Kind>{Kind::kOpen, Kind::kDetachDriver, Kind::kClaim, Kind::kClaim,
                               Kind::kRelease, Kind::kRelease, Kind::kAttachDriver, Kind::kClose}));
}

TEST(UsbEmulator, IsBusyWhenAnotherProgramHasIt) {
  TouchEmulator touch;
  touch.SetFaults({.busy = true});
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  const ProcessResult result = Process(Client(bus, {"touch", "10"})).Wait();
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(Contains(result.output, "claim: LIBUSB_ERROR_BUSY")) << result.output;
}

TEST(UsbEmulator, MayBeClosedToThisUser) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch, false);
  const ProcessResult result = Process(Client(bus, {"touch", "10"}, true)).Wait();
  EXPECT_EQ(result.exit_code, 1) << result.error;
  EXPECT_TRUE(Contains(result.output, "open: ")) << result.output;
  EXPECT_TRUE(touch.Events().empty());
}

TEST(UsbEmulator, StallsUntilItIsCleared) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  Process client(Client(bus, {"touch", "1000"}));
  ASSERT_TRUE(Eventually([&] { return touch.Forces().size() > 100; }));
  touch.Stall(TouchEmulator::kDataIn, false);
  const ProcessResult result = client.Wait();
  EXPECT_EQ(result.exit_code, 0) << result.output << result.error;
  EXPECT_TRUE(Contains(result.output, "stall state\nrecovered\n")) << result.output;
  EXPECT_EQ(touch.CountOf(Kind::kClearHalt), 1u);
}

TEST(UsbEmulator, StallsForEver) {
  TouchEmulator touch;
  touch.Stall(TouchEmulator::kDataOut, true);
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  touch.Stall(TouchEmulator::kDataOut, true);
  const ProcessResult result = Process(Client(bus, {"touch", "10"})).Wait();
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(Contains(result.output, "send: LIBUSB_ERROR_PIPE")) << result.output;
}

TEST(UsbEmulator, IsSilentAndDeafOnDemand) {
  TouchEmulator touch;
  touch.SetFaults({.silent = true});
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  ProcessResult result = Process(Client(bus, {"touch", "10"})).Wait();
  EXPECT_TRUE(Contains(result.output, "answer: LIBUSB_ERROR_TIMEOUT")) << result.output;
  touch.SetFaults({.deaf = true});
  result = Process(Client(bus, {"touch", "10"})).Wait();
  EXPECT_TRUE(Contains(result.output, "send: LIBUSB_ERROR_TIMEOUT")) << result.output;
  touch.SetFaults({.control_stall = true});
  result = Process(Client(bus, {"touch", "10"})).Wait();
  EXPECT_TRUE(Contains(result.output, "control: LIBUSB_ERROR_PIPE")) << result.output;
}

TEST(UsbEmulator, CutsItsFrames) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  Process client(Client(bus, {"touch", "300"}));
  ASSERT_TRUE(Eventually([&] { return touch.Forces().size() > 50; }));
  touch.SetFaults({.cut_in_to = 7});
  const ProcessResult result = client.Wait();
  EXPECT_EQ(result.exit_code, 0) << result.output << result.error;
  EXPECT_TRUE(Contains(result.output, "short 7\n")) << result.output;
}

TEST(UsbEmulator, IsPulledOutWhileItStreamsAndComesBack) {
  TouchEmulator touch;
  UsbTestbed bus;
  for (int n = 0; n < 2; ++n) {
    bus.Plug("1-2", touch);
    const std::size_t before = touch.Forces().size();
    Process client(Client(bus, {"touch", "100000"}));
    ASSERT_TRUE(Eventually([&] { return touch.Forces().size() > before + 100; }));
    bus.Unplug("1-2");
    const ProcessResult result = client.Wait();
    EXPECT_EQ(result.exit_code, 1);
    // As the end of a transfer, or as the refusal of the next.
    EXPECT_TRUE(Contains(result.output, ": gone") ||
                Contains(result.output, "submit: LIBUSB_ERROR_NO_DEVICE"))
        << result.output;
  }
}

}  // namespace
}  // namespace palpate::test
