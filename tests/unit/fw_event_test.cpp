// Bytes of /dev/fw* as values, and the serial number in a GUID.
#include "server/device/firewire/fw_node.h"

#include <gtest/gtest.h>
#include <linux/firewire-cdev.h>

#include <cstring>
#include <random>
#include <vector>

#include "server/device/omni/omni_firewire.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;

bool IsWithin(std::span<const std::uint8_t> part, const Bytes& whole) {
  return part.empty() ||
         (part.data() >= whole.data() && part.data() + part.size() <= whole.data() + whole.size());
}

// No event leads outside of its bytes, whatever they say.
TEST(FwEvent, TenMillionRandomEventsStayWithinTheirBytes) {
  std::mt19937_64 random(7);
  Bytes bytes;
  std::uint64_t parsed = 0, packets = 0;
  for (int n = 0; n < 10'000'000; ++n) {
    bytes.resize(random() % 400);
    for (std::size_t at = 0; at + 8 <= bytes.size(); at += 8) {
      const std::uint64_t word = random();
      std::memcpy(&bytes[at], &word, 8);
    }
    // Mostly a known type and a length that may fit.
    const auto put = [&](std::size_t at, std::uint32_t value) {
      if (at + 4 <= bytes.size()) std::memcpy(&bytes[at], &value, 4);
    };
    if (n % 8 != 0) put(8, static_cast<std::uint32_t>(random() % 10));
    if (n % 2 != 0) put(8, FW_CDEV_EVENT_ISO_INTERRUPT);
    if (n % 4 != 0) put(16, static_cast<std::uint32_t>(random() % 420));
    const std::optional<FwEvent> event = ParseFwEvent(bytes);
    if (!event) continue;
    ++parsed;
    if (const auto* response = std::get_if<FwResponse>(&*event)) {
      ASSERT_TRUE(IsWithin(response->data, bytes));
    }
    const auto* received = std::get_if<FwPackets>(&*event);
    if (received == nullptr) continue;
    ASSERT_TRUE(IsWithin(received->headers, bytes));
    std::span<const std::uint8_t> headers = received->headers;
    while (const std::optional<FwPacket> packet = TakeFwPacket(headers)) {
      ++packets;
      ASSERT_TRUE(IsWithin(packet->payload, bytes));
      ASSERT_LE(packet->payload.size(), kFwPacketBytes);
      ASSERT_GE(packet->cycle, 0);
      ASSERT_LT(packet->cycle, kFwCycles);
    }
  }
  EXPECT_GT(parsed, 1'000'000u);
  EXPECT_GT(packets, 1'000'000u);
}

TEST(FwEvent, APacketHasItsLengthTimeAndBytes) {
  Bytes headers(2 * kFwPacketHeaderBytes, 0xee);
  const Bytes first = {0x00, 0x2b, 0x40, 0xa0, 0x12, 0x34, 0x60, 0x05};  // 43 bytes, 3 s, cycle 5
  std::copy(first.begin(), first.end(), headers.begin());
  headers[8] = 1;
  headers[kFwPacketHeaderBytes] = 0x01;  // 256 bytes or more
  std::span<const std::uint8_t> left = headers;
  const std::optional<FwPacket> packet = TakeFwPacket(left);
  ASSERT_TRUE(packet);
  EXPECT_EQ(packet->length, 43u);
  EXPECT_EQ(packet->payload.size(), 43u);
  EXPECT_EQ(packet->payload[0], 1);
  EXPECT_EQ(packet->cycle, 3 * 8000 + 5);
  const std::optional<FwPacket> longer = TakeFwPacket(left);
  ASSERT_TRUE(longer);
  EXPECT_EQ(longer->length, 0x01eeu);
  EXPECT_EQ(longer->payload.size(), kFwPacketBytes);
  EXPECT_FALSE(TakeFwPacket(left));
}

// Of two devices, from public logs.
TEST(OmniSerial, IsInTheGuidsLowerWord) {
  EXPECT_EQ(OmniSerialOf(0x000b990080df6000), "11129400000");
  EXPECT_EQ(OmniSerialOf(0x000b990083a6d80e), "70427300007");
}

}  // namespace
}  // namespace palpate
