// Events of /dev/fw*: what read() returns, as values.
//
// Source: linux/firewire-cdev.h.
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <variant>

namespace palpate {

// The longest event with packets: the kernel collects at most a page of headers.
inline constexpr std::size_t kFwEventBytes = 4096 + 24;

// What of a received packet comes in its event: its header, its time, and this many bytes of it.
inline constexpr std::size_t kFwPacketBytes = 64;
inline constexpr std::size_t kFwPacketHeaderBytes = 8 + kFwPacketBytes;

struct FwBusReset {
  std::uint32_t generation = 0;
};
struct FwResponse {
  std::uint64_t request = 0;  // its number
  std::uint32_t rcode = 0;
  std::span<const std::uint8_t> data{};
};
struct FwResource {
  bool allocated = false;  // false: given back, or lost after a bus reset
  int channel = -1;        // below 0: none
};
// Packets that a context has received or sent.
struct FwPackets {
  std::span<const std::uint8_t> headers{};
};
using FwEvent = std::variant<FwBusReset, FwResponse, FwResource, FwPackets>;

// `bytes`: what one read() gave. The result refers to them. None: another event, or one that is
// cut.
std::optional<FwEvent> ParseFwEvent(std::span<const std::uint8_t> bytes) noexcept;

struct FwPacket {
  std::span<const std::uint8_t> payload{};  // of longer packets the first kFwPacketBytes
  std::size_t length = 0;                   // as it was sent
  int cycle = 0;                            // of 1/8000 s, in 0 to kFwCycles - 1
};
inline constexpr int kFwCycles = 8 * 8000;

// Cuts the first received packet off `headers`. None: there is no whole one.
std::optional<FwPacket> TakeFwPacket(std::span<const std::uint8_t>& headers) noexcept;

}  // namespace palpate
