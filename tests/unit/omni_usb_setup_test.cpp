// Setting up a Touch on USB, without USB: the serial line, who it is, the servo's start,
// and the farewell.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <optional>
#include <random>
#include <vector>

#include "server/device/omni/cdc_line.h"
#include "server/device/omni/omni_usb_identity.h"
#include "server/device/omni/omni_usb_protocol.h"
#include "tests/support/omni_frames.h"
#include "tests/support/scaled.h"
#include "tests/support/scripted_usb_link.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using test::Framed;
using test::kOmniForce;
using test::NamedOmniUsbOptions;

// Answers as the published trace's device.
struct FakeTouch {
  FakeTouch() {
    usb.found = {.ids = {0x2988, 0x0302}, .port = "1-2", .may_open = true};
    usb.control = [this](const test::ScriptedUsb::Request& request, std::span<std::uint8_t> data) {
      return Control(request, data);
    };
    usb.send = [this](const Bytes& frame) { Take(frame); };
    test::SetScriptedUsb(usb);
  }

  std::size_t Control(const test::ScriptedUsb::Request& request, std::span<std::uint8_t> data) {
    if (request.request_type == 0x80) {
      if (!shows_descriptors) throw UsbError(UsbFault::kStall, "stalled");
      std::copy(descriptors.begin(), descriptors.end(), data.begin());
      return descriptors.size();
    }
    if (request.request == 0x23) deaf = deaf && !break_mends;
    if (refuses_line) throw UsbError(UsbFault::kStall, "stalled");
    return data.size();
  }

  void Take(const Bytes& frame) {
    if (deaf) return;
    Bytes reply;
    if (frame[2] == 0x0f && --ignored_queries < 0) {
      reply = Bytes(32, 0);
      std::copy_n("Touch v5.18", 11, reply.begin() + 2);
      reply = Framed(0x0e, reply);
    } else if (frame[2] == 0x0c) {
      reply = Bytes(97, 0xff);
      std::copy_n("00123\0\n\x1b[31mB", 13, reply.begin());
      reply = Framed(0x09, reply);
    }
    // In two parts, after bytes of before.
    usb.in.push_back({1, 2, 0xa5});
    usb.in.emplace_back(reply.begin(), reply.begin() + reply.size() / 2);
    usb.in.emplace_back(reply.begin() + reply.size() / 2, reply.end());
  }

  std::vector<std::uint8_t> Commands() const {
    std::vector<std::uint8_t> commands;
    for (const Bytes& frame : usb.sent) commands.push_back(frame.at(2));
    return commands;
  }

  std::size_t Breaks() const {
    return static_cast<std::size_t>(
        std::count_if(usb.requests.begin(), usb.requests.end(),
                      [](const auto& request) { return request.request == 0x23; }));
  }

  test::ScriptedUsb usb;
  Bytes descriptors = {9, 2,    67, 0,    2, 1,    0, 0xc0, 50,  //
                       9, 4,    3,  0,    1, 2,    2, 1,    0,   // control: interface 3
                       5, 0x24, 0,  0x10, 1,                     //
                       9, 4,    4,  0,    2, 0x0a, 0, 0,    0};  // data
  bool shows_descriptors = true;
  bool refuses_line = false;
  bool deaf = false;
  bool break_mends = false;
  int ignored_queries = 0;
};

class OmniUsbSetUpTest : public ::testing::Test {
 protected:
  std::string SetUpLine() { return protocol_->SetUp(link_, false); }
  UsbError FailureOfSetUp(bool stopping = false) {
    const std::atomic<bool> stop = stopping;
    try {
      protocol_->SetUp(link_, stop);
    } catch (const UsbError& error) {
      return error;
    }
    ADD_FAILURE() << "no failure";
    return UsbError(UsbFault::kBroken, "");
  }

  FakeTouch touch_;
  std::optional<OmniUsbProtocol> protocol_{NamedOmniUsbOptions()};
  UsbLink link_{protocol_->match()};
};

TEST_F(OmniUsbSetUpTest, ItSaysWhoItIsAndStreams) {
  OmniUsbOptions options = NamedOmniUsbOptions();
  (*options.init_payload)[3] = 17;
  protocol_.emplace(options);
  EXPECT_EQ(SetUpLine(), "serial 00123 [31mB, firmware Touch v5.18");
  EXPECT_EQ(touch_.Commands(), (Bytes{0x0f, 0x0c, 0x04, 0x07}));
  EXPECT_EQ(touch_.usb.sent[2].size(), 64u);
  EXPECT_EQ(touch_.usb.sent[2][7], 17);
  EXPECT_EQ(touch_.usb.sent[3], (Bytes{0xa5, 0x5a, 7, 7, 1, 0, 0, 0x80, 0, 0, 0}));
  // The line, on the control interface.
  ASSERT_EQ(touch_.usb.requests.size(), 3u);
  EXPECT_EQ(touch_.usb.requests[1].request, 0x20);
  EXPECT_EQ(touch_.usb.requests[1].request_type, 0x21);
  EXPECT_EQ(touch_.usb.requests[1].index, 3);
  EXPECT_EQ(touch_.usb.requests[1].data, (Bytes{0x00, 0xc2, 0x01, 0x00, 0, 0, 8}));
  EXPECT_EQ(touch_.usb.requests[2].request, 0x22);
  EXPECT_EQ(touch_.usb.requests[2].value, 3);

  touch_.usb.sent.clear();
  protocol_->TearDown(link_);
  EXPECT_EQ(touch_.Commands(), (Bytes{kOmniForce, 0x07}));
  EXPECT_EQ(touch_.usb.sent[0], Framed(kOmniForce, EncodeOmniForce({})));
  EXPECT_EQ(touch_.usb.sent[1][4], 0);
}

TEST_F(OmniUsbSetUpTest, WithoutNamedFramesItEndsWithWhoItIsAndWhatToDo) {
  protocol_.emplace(OmniUsbOptions{});
  const UsbError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), UsbFault::kUnsuitable);
  for (const char* part : {"1-2", "serial 00123 [31mB", "Touch v5.18", "devices.md", "`frames`"}) {
    EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
  }
  // Nothing but the questions.
  EXPECT_EQ(touch_.Commands(), (Bytes{0x0f, 0x0c}));
  protocol_->TearDown(link_);
  EXPECT_EQ(touch_.usb.sent.size(), 2u);
}

TEST_F(OmniUsbSetUpTest, AHidTouchIsKnownAndRefused) {
  EXPECT_NE(protocol_->match().problem_of({0x2988, 0x0304}).find("HID"), std::string::npos);
  EXPECT_TRUE(OmniUsbProblem({0x2988, 0x0302}).empty());
  EXPECT_EQ(OmniUsbIds().size(), 3u);
}

TEST_F(OmniUsbSetUpTest, AQueryIsAskedTwice) {
  touch_.ignored_queries = 1;
  EXPECT_FALSE(SetUpLine().empty());
  EXPECT_EQ(touch_.Commands(), (Bytes{0x0f, 0x0f, 0x0c, 0x04, 0x07}));
  EXPECT_EQ(touch_.Breaks(), 0u);
}

TEST_F(OmniUsbSetUpTest, ADeafDeviceGetsABreakOnceAndNoFarewell) {
  touch_.deaf = true;
  touch_.break_mends = true;
  EXPECT_FALSE(SetUpLine().empty());
  EXPECT_EQ(touch_.Breaks(), 1u);

  touch_.deaf = true;
  touch_.break_mends = false;
  touch_.usb.requests.clear();
  const UsbError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), UsbFault::kTimeout);
  EXPECT_NE(std::string(error.what()).find("unplug"), std::string::npos);
  EXPECT_EQ(touch_.Breaks(), 1u);
  // Who did not say who it is gets no frame of a Touch.
  touch_.usb.sent.clear();
  protocol_->TearDown(link_);
  EXPECT_TRUE(touch_.usb.sent.empty());
}

TEST_F(OmniUsbSetUpTest, StopIsHeeded) {
  touch_.deaf = true;
  EXPECT_EQ(FailureOfSetUp(true).fault(), UsbFault::kTimeout);
  EXPECT_TRUE(touch_.usb.sent.empty());
  EXPECT_EQ(touch_.Breaks(), 0u);
}

TEST_F(OmniUsbSetUpTest, ALineThatCannotBeSetIsNoLine) {
  touch_.refuses_line = true;
  touch_.shows_descriptors = false;
  EXPECT_FALSE(SetUpLine().empty());
  EXPECT_EQ(touch_.usb.requests[1].index, 0);
}

TEST_F(OmniUsbSetUpTest, ANewConnectionForgetsTheLast) {
  DeviceState state;
  const auto receive = [&](const test::OmniReading& reading) {
    return protocol_->Receive(Framed(test::kOmniState, test::OmniStatePayload(reading)), state);
  };
  receive({.docked = true, .counter = 5});
  protocol_->Receive(Bytes{0xa5, 0x5a, test::kOmniState}, state);
  SetUpLine();
  const UsbReceived received = receive({.counter = 100});
  EXPECT_EQ(received.readings, 1u);
  EXPECT_EQ(received.lost_readings, 0u);
  EXPECT_EQ(received.corrupt_frames, 0u);
  EXPECT_FALSE(state.calibrated);
}

TEST_F(OmniUsbSetUpTest, AFarewellToADeviceThatIsGoneIsQuiet) {
  SetUpLine();
  touch_.usb.send = [](const Bytes&) { throw UsbError(UsbFault::kAbsent, "gone"); };
  touch_.usb.sent.clear();
  protocol_->TearDown(link_);
  EXPECT_EQ(touch_.Commands(), (Bytes{kOmniForce, 0x07}));  // both are tried
}

TEST(CdcLine, TheControlInterfaceIsFoundInAnyBytes) {
  const FakeTouch touch;
  EXPECT_EQ(CdcInterface(touch.descriptors, 2, 9), 3);
  EXPECT_EQ(CdcInterface(touch.descriptors, 0x0a, 9), 4);
  EXPECT_EQ(CdcInterface(touch.descriptors, 0x03, 9), 9);
  EXPECT_EQ(CdcInterface({}, 2, 9), 9);
  EXPECT_EQ(CdcInterface(Bytes(100, 0), 2, 9), 9);
  for (std::size_t cut = 0; cut < touch.descriptors.size(); ++cut) {
    CdcInterface(std::span(touch.descriptors).first(cut), 0x0a, 9);
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
