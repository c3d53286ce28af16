// A Touch on USB, without USB: the serial line, and who it is.
#include <gtest/gtest.h>

#include <atomic>
#include <optional>
#include <random>
#include <vector>

#include "server/device/omni/omni_usb_protocol.h"
#include "tests/support/omni_frames.h"
#include "tests/support/scaled.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_error.h"

namespace palpate {
namespace {

using test::Bytes;

class OmniUsbSetUpTest : public ::testing::Test {
 protected:
  using Kind = test::UsbEvent::Kind;

  OmniUsbSetUpTest() {
    test::SetDirectUsb(touch_);
    link_.emplace(protocol_.match());
  }

  BusError FailureOfSetUp(bool stopping = false) {
    const std::atomic<bool> stop = stopping;
    return test::BusErrorOf([&] { protocol_.SetUp(*link_, stop); });
  }
  // What the host did since the last call.
  struct Actions {
    std::vector<Bytes> requests{}, frames{};
    Bytes commands{};  // of the frames
    std::ptrdiff_t breaks = 0;
  };
  Actions TakeActions() {
    Actions actions;
    const std::vector<test::UsbEvent> events = touch_.Events();
    for (; taken_ < events.size(); ++taken_) {
      const test::UsbEvent& event = events[taken_];
      if (event.kind == Kind::kControl) {
        actions.requests.push_back(event.bytes);
        actions.breaks += event.number == 0x23;
      } else {
        actions.frames.push_back(event.bytes);
        actions.commands.push_back(event.bytes.at(2));
      }
    }
    return actions;
  }

  test::TouchEmulator touch_;
  OmniUsbProtocol protocol_;
  std::optional<UsbLink> link_;

 private:
  std::size_t taken_ = 0;
};

TEST_F(OmniUsbSetUpTest, ItEndsWithWhoItIsAndWhatToDo) {
  const BusError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), BusFault::kUnsuitable);
  for (const char* part : {"1-2", "serial EMULATED0001, firmware emulated 1.0", "devices.md"}) {
    EXPECT_TRUE(test::Says(error, part)) << error.what();
  }
  protocol_.TearDown(*link_);
  // Nothing but the questions.
  const Actions set_up = TakeActions();
  EXPECT_EQ(set_up.commands, (Bytes{0x0f, 0x0c}));
  // The line: its coding and its state, on the control interface.
  constexpr std::uint8_t kControl = test::TouchEmulator::kControlInterface;
  ASSERT_EQ(set_up.requests.size(), 3u);
  EXPECT_EQ(set_up.requests[1], (Bytes{0x21, 0x20, 0, 0, kControl, 0, 7, 0,  //
                                       0x00, 0xc2, 0x01, 0x00, 0, 0, 8}));
  EXPECT_EQ(set_up.requests[2], (Bytes{0x21, 0x22, 3, 0, kControl, 0, 0, 0}));
}

TEST_F(OmniUsbSetUpTest, NeitherReadingNorForce) {
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  EXPECT_EQ(protocol_.Encode({{Vec3(1, 1, 1)}, true}, out), 0u);
  DeviceState state;
  EXPECT_FALSE(protocol_.Receive(Bytes(100, 0xa5), state).has_reading);
  const DeviceDescription& spec = protocol_.spec();
  EXPECT_EQ(spec.verification_level, VerificationLevel::kNone);
  EXPECT_TRUE(IsHardware(spec));
  // No forces and buttons that nobody can feel or press are promised.
  EXPECT_EQ(spec.max_force_n + spec.continuous_force_n + spec.max_stiffness_n_per_mm, 0.0);
  EXPECT_EQ(spec.button_count, 0u);
}

TEST_F(OmniUsbSetUpTest, ItNamesTheKindsToUseInsteadBeforeOneIsPluggedIn) {
  for (const char* kind : {"openhaptics", "omni-firewire"}) {
    EXPECT_NE(protocol_.spec().model.find(kind), std::string::npos);
    EXPECT_NE(OmniUsbProblem({0x2988, 0x0302}).find(kind), std::string::npos);
    EXPECT_NE(OmniUsbNotFound().find(kind), std::string::npos);
  }
}

TEST_F(OmniUsbSetUpTest, AHidTouchIsKnownAndRefused) {
  EXPECT_NE(protocol_.match().problem_of({0x2988, 0x0304}).find("HID"), std::string::npos);
  EXPECT_TRUE(protocol_.match().problem_of({0x2988, 0x0302}).empty());  // asked who it is
  EXPECT_EQ(OmniUsbIds().size(), 3u);
}

TEST_F(OmniUsbSetUpTest, AQueryIsAskedTwice) {
  touch_.queries_without_answer = 1;
  EXPECT_EQ(FailureOfSetUp().fault(), BusFault::kUnsuitable);
  const Actions actions = TakeActions();
  EXPECT_EQ(actions.commands, (Bytes{0x0f, 0x0f, 0x0c}));
  EXPECT_EQ(actions.breaks, 0);
}

TEST_F(OmniUsbSetUpTest, ASilentDeviceGetsABreakOnce) {
  touch_.SetFaults({.silent = true});
  touch_.break_mends = true;
  EXPECT_EQ(FailureOfSetUp().fault(), BusFault::kUnsuitable);
  EXPECT_EQ(TakeActions().breaks, 1);

  touch_.SetFaults({.silent = true});
  touch_.break_mends = false;
  const BusError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), BusFault::kTimeout);
  EXPECT_TRUE(test::Says(error, "unplug"));
  EXPECT_EQ(TakeActions().breaks, 1);
}

TEST_F(OmniUsbSetUpTest, StopIsHeeded) {
  touch_.SetFaults({.silent = true});
  EXPECT_EQ(FailureOfSetUp(true).fault(), BusFault::kTimeout);
  const Actions actions = TakeActions();
  EXPECT_TRUE(actions.frames.empty());
  EXPECT_EQ(actions.breaks, 0);
}

TEST_F(OmniUsbSetUpTest, ALineThatCannotBeSetIsNoLine) {
  touch_.SetFaults({.refuses_requests = true});
  EXPECT_EQ(FailureOfSetUp().fault(), BusFault::kUnsuitable);
  EXPECT_EQ(TakeActions().requests[1][4], 0);  // the interface: without descriptors the first
}

TEST(CdcLine, TheControlInterfaceIsFoundInAnyBytes) {
  const Bytes descriptors = {9, 2,    67, 0,    2, 1,    0, 0xc0, 50,  //
                             9, 4,    3,  0,    1, 2,    2, 1,    0,   // control: interface 3
                             5, 0x24, 0,  0x10, 1,                     //
                             9, 4,    4,  0,    2, 0x0a, 0, 0,    0};  // data
  EXPECT_EQ(CdcInterface(descriptors, 2, 9), 3);
  EXPECT_EQ(CdcInterface(descriptors, 0x0a, 9), 4);
  EXPECT_EQ(CdcInterface(descriptors, 0x03, 9), 9);
  EXPECT_EQ(CdcInterface({}, 2, 9), 9);
  EXPECT_EQ(CdcInterface(Bytes(100, 0), 2, 9), 9);
  for (std::size_t cut = 0; cut < descriptors.size(); ++cut) {
    CdcInterface(std::span(descriptors).first(cut), 0x0a, 9);
  }
  std::mt19937 random(6);
  for (int n = 0; n < test::Scaled(20000); ++n) {
    Bytes bytes(random() % 60);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() % 12);
    CdcInterface(bytes, 2, 0);
  }
}

TEST(OmniUsbIdentity, OnlyPrintableBytesAreShown) {
  EXPECT_EQ(PrintableText(Bytes{0, 'a', 0, 0, 'b', ' ', 'c', 0x7f, 0xff}), "a b c");
  EXPECT_EQ(PrintableText(Bytes{0, 0x1b, 0x9b}), "unknown");
  EXPECT_EQ(PrintableText({}), "unknown");
}

}  // namespace
}  // namespace palpate
