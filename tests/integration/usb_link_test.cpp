// UsbLink against emulated devices in this process: which device it takes, and how it
// takes and leaves it. And the log of a device.
#include "server/device/usb/usb_link.h"

#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "server/device/stream/device_seat.h"
#include "tests/support/patience.h"
#include "tests/support/plain_stylus.h"
#include "tests/support/usb_error.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

using std::chrono::milliseconds;
using Kind = UsbEvent::Kind;

const UsbMatch kMatch = PlainProtocol().match();
constexpr milliseconds kPatience{60'000};

BusError RefusalOf(const UsbMatch& match) {
  return BusErrorOf([&] { const UsbLink link(match); });
}

class UsbLinkTest : public ::testing::Test {
 protected:
  PlainStylus stylus_, other_;
  UsbTestbed bus_;
};

TEST_F(UsbLinkTest, FindsWhatIsPluggedIn) {
  EXPECT_TRUE(FindUsbDevices(kMatch.ids).empty());
  EXPECT_EQ(RefusalOf(kMatch).fault(), BusFault::kAbsent);
  bus_.Plug("1-2", other_, false);
  bus_.Plug("1-1", stylus_);
  const std::vector<UsbFound> found = FindUsbDevices(kMatch.ids);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].port, "1-1");
  EXPECT_EQ(found[1].port, "1-2");
  EXPECT_EQ(found[0].ids, kMatch.ids[0]);
  EXPECT_TRUE(found[0].may_open && !found[1].may_open);
  EXPECT_TRUE(FindUsbDevices({{.vendor = 0x1209, .product = 0x0002}}).empty());
  EXPECT_EQ(stylus_.CountOf(Kind::kOpen) + other_.CountOf(Kind::kOpen), 0u);
}

TEST_F(UsbLinkTest, TakesTheKernelsDriverOffAndGivesItBack) {
  bus_.Plug("1-1", stylus_);
  {
    const UsbLink link(kMatch);
    EXPECT_EQ(stylus_.CountOf(Kind::kDetachDriver), 1u);
    EXPECT_EQ(stylus_.CountOf(Kind::kClaim), 2u);
  }
  EXPECT_EQ(stylus_.CountOf(Kind::kRelease), 2u);
  EXPECT_EQ(stylus_.CountOf(Kind::kAttachDriver), 1u);

  stylus_.SetFaults({.busy = true});
  EXPECT_EQ(RefusalOf(kMatch).fault(), BusFault::kBusy);
  EXPECT_EQ(stylus_.CountOf(Kind::kDetachDriver), stylus_.CountOf(Kind::kAttachDriver));
}

TEST_F(UsbLinkTest, WantsDataEndpointsOfTheClass) {
  bus_.Plug("1-1", stylus_);
  for (const std::uint8_t data_class : {std::uint8_t{2}, std::uint8_t{3}}) {
    UsbMatch match = kMatch;
    match.data_class = data_class;  // one endpoint only, or no such interface
    EXPECT_EQ(RefusalOf(match).fault(), BusFault::kUnsuitable);
  }
}

TEST_F(UsbLinkTest, WhatIsKnownToBeNoneIsNotOpened) {
  bus_.Plug("1-1", stylus_);
  UsbMatch match = kMatch;
  match.problem_of = [](const UsbMatch::Ids&) { return std::string("it speaks in tongues"); };
  const BusError refusal = RefusalOf(match);
  EXPECT_EQ(refusal.fault(), BusFault::kUnsuitable);
  EXPECT_TRUE(Says(refusal, "1-1") && Says(refusal, "it speaks in tongues")) << refusal.what();
  EXPECT_EQ(stylus_.CountOf(Kind::kClaim), 0u);
}

TEST_F(UsbLinkTest, SendsAndReceives) {
  bus_.Plug("1-1", stylus_);
  UsbLink link(kMatch);
  std::array<std::uint8_t, 64> bytes{};
  milliseconds timeout{50};
  const auto receive = [&] { return link.Receive(bytes, timeout); };
  EXPECT_EQ(BusErrorOf(receive).fault(), BusFault::kTimeout);
  timeout = kPatience;
  EXPECT_EQ(link.Control(kPlainRequest, kPlainStart, 0, 0, {}, kPatience), 0u);
  EXPECT_EQ(receive(), 4u);
  EXPECT_EQ(bytes[0], 0x5a);
  link.Send(std::array<std::uint8_t, 4>{0xa5, 1, 100, 0}, kPatience);
  ASSERT_EQ(stylus_.Forces().size(), 1u);
  EXPECT_EQ(stylus_.Forces()[0].x_n, 1.0);

  const auto refused = [&] { link.Control(kPlainRequest, 77, 0, 0, {}, kPatience); };
  EXPECT_EQ(BusErrorOf(refused).fault(), BusFault::kStall);
  stylus_.Stall(kPlainIn, false);
  EXPECT_EQ(BusErrorOf(receive).fault(), BusFault::kStall);
  EXPECT_EQ(receive(), 4u);  // it was cleared
  bus_.Unplug("1-1");
  EXPECT_EQ(BusErrorOf(receive).fault(), BusFault::kAbsent);
}

TEST_F(UsbLinkTest, SendsAndReceivesAgainAfterAStream) {
  bus_.Plug("1-1", stylus_);
  UsbLink link(kMatch);
  link.Control(kPlainRequest, kPlainStart, 0, 0, {}, kPatience);
  for (int round = 0; round < 3; ++round) {
    std::size_t received = 0;
    link.StartStream(10, [&](std::span<const std::uint8_t> bytes) { received += bytes.size(); },
                     {});
    EXPECT_TRUE(link.TrySend(std::array<std::uint8_t, 4>{0xa5, 0, 0, 0}));
    EXPECT_FALSE(link.TrySend(std::array<std::uint8_t, 4>{0xa5, 0, 0, 0}));  // under way
    EXPECT_TRUE(Eventually([&] {
      link.Wait(milliseconds(10));
      return received >= 40;
    }));
    link.EndStream();
    std::array<std::uint8_t, 64> bytes{};
    EXPECT_EQ(link.Receive(bytes, kPatience), 4u);
  }
  EXPECT_EQ(link.transfer_errors(), 0u);
}

std::vector<std::string> LinesOf(DeviceLog& log) {
  std::vector<std::string> lines;
  while (const std::optional<DeviceEvent> event = log.Next()) lines.push_back(event->text);
  return lines;
}

std::string ProblemOf(const DeviceLog& log) {
  DeviceHealth health;
  log.FillIn(health);
  return health.problem;
}

TEST(DeviceLog, HasOneLinePerChange) {
  DeviceLog log("falcon");
  for (int i = 0; i < 3; ++i) log.SetProblem("not found: plug it in");
  EXPECT_EQ(ProblemOf(log), "not found: plug it in");
  log.SetProblem("in use");
  log.SetConnected("USB port 1-2.3", "");
  EXPECT_EQ(ProblemOf(log), "");
  log.SetConnected("USB port 1-2", "serial 7");
  log.SetProblem("in use");
  EXPECT_EQ(LinesOf(log), (std::vector<std::string>{
                              "falcon: not found: plug it in", "falcon: in use",
                              "falcon on USB port 1-2.3: connected",
                              "falcon on USB port 1-2: connected, serial 7", "falcon: in use"}));
  EXPECT_FALSE(log.Next().has_value());
}

TEST(DeviceLog, LosesTheOldestWhereNobodyReads) {
  DeviceLog log("falcon");
  for (int i = 0; i < 1000; ++i) log.Add(DeviceEvent::Level::kInfo, std::to_string(i));
  const std::vector<std::string> lines = LinesOf(log);
  ASSERT_EQ(lines.size(), DeviceLog::kMaxEvents);
  EXPECT_EQ(lines.back(), "falcon: 999");
}

}  // namespace
}  // namespace palpate::test
