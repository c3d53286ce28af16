// An emulated Phantom Omni with FireWire, for the tests. It shares no code with the driver.
//
// Facts, from public drivers (none of them checked by us on a device):
// - 1-byte registers by block transactions: 0x1000 (channel on which it listens), 0x1001 (channel
//   on which it talks), 0x1087 (bit 3: streams), 0x1083 and 0x1082 (0xc0 and 0x00, read only).
// - Quadlets by quadlet transactions: 0x20010 (write), 0x1006000c and 0x10060010 (read; the GUID).
// - Packets from it: 44 bytes of state, perhaps zeros after them. Packets to it: 16 bytes at S100.
// Our assumptions:
// - It answers other accesses with an error.
// - It moves its motors only after a packet without force, sent since its stream began.
// - It keeps its last force when packets stop, also when it is unplugged, and ends the force when
//   its stream ends.
// - A bus reset ends its stream and clears its channels, or does nothing.
//
// Threads: as EmulatedFirewireDevice.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <utility>

#include "tests/support/firewire_emulator.h"

namespace palpate::test {

// What the device measures of the hand.
struct OmniHand {
  std::array<int, 3> encoders{};                   // as sent: the second counts down
  std::array<double, 3> gimbal = {0.5, 0.5, 0.5};  // of the potentiometers' range, 0 to 1
  unsigned pressed = 0;                            // bit n: button n
  bool docked = false;
};

// What it sends, and how.
struct OmniStream {
  unsigned cycles_per_packet = 8;  // 1: 8 kHz
  std::size_t payload_bytes = 44;
  unsigned tag = 0;
  bool silent = false;        // sends nothing
  bool zero_gimbal = false;   // as with a loose plug
  bool gimbal_noise = false;  // in the words' low 5 bits
};

// A packet that it took.
struct OmniForcePacket {
  std::int64_t time_ns = 0;
  std::uint64_t cycle = 0;
  std::array<int, 3> motors{};  // counts; 0: no force
  bool force_enabled = false;
  bool moved_motors = false;
  unsigned dock_light = 0;  // bits 0 and 1 of its status
};

class OmniFirewireEmulator final : public EmulatedFirewireDevice {
 public:
  static constexpr std::uint64_t kListenChannel = 0x1000, kTalkChannel = 0x1001;
  static constexpr std::uint64_t kControl = 0x1087, kUnknown = 0x20010;
  static constexpr std::uint64_t kVendor = 0x1006000c, kSerial = 0x10060010;
  static constexpr std::uint8_t kStreams = 0x08;  // of kControl

  // serial_word: the GUID's lower half, here that of a real device, 70427300007.
  explicit OmniFirewireEmulator(std::uint32_t serial_word = 0x83a6d80e);

  void SetHand(const OmniHand& hand) {
    SetPath([hand](int) { return hand; });
  }
  // The hand, by the number of packets that answer a force, from now. A slow bus thus makes the
  // hand slow, and never makes it leap.
  using Path = std::function<OmniHand(int)>;
  void SetPath(Path path) {
    const std::scoped_lock lock(mutex());
    path_ = std::move(path);
    step_ = 0;
  }
  void SetStream(const OmniStream& stream) {
    const std::scoped_lock lock(mutex());
    stream_ = stream;
  }

  // The packets that it took, oldest first, but for the first `but`. They had effect only if it
  // streamed.
  std::vector<OmniForcePacket> Forces(std::size_t but = 0) const {
    const std::scoped_lock lock(mutex());
    return {forces_.begin() + static_cast<std::ptrdiff_t>(but), forces_.end()};
  }
  std::size_t force_count() const {
    const std::scoped_lock lock(mutex());
    return forces_.size();
  }
  // The packets on the bus that it did not hear: on another channel, or while it is deaf.
  std::uint64_t packets_not_heard() const {
    const std::scoped_lock lock(mutex());
    return not_heard_;
  }
  // In motor counts.
  std::array<int, 3> ForceOnHand() const;
  // None: never written since it was plugged in or lost its registers.
  std::optional<std::uint8_t> Register(std::uint64_t address) const;
  Bytes unknown_quadlet() const {  // as it came over the bus
    const std::scoped_lock lock(mutex());
    return unknown_;
  }
  std::uint64_t packets_sent() const {
    const std::scoped_lock lock(mutex());
    return sent_;
  }

  std::atomic<bool> keeps_registers_at_reset = false;
  std::atomic<bool> goes_deaf_at_reset = false;    // forgets where it listens, and streams on
  std::atomic<bool> begins_anew_at_reset = false;  // counts its packets from 0 again
  std::atomic<bool> needs_force_edge = true;
  std::atomic<std::uint32_t> vendor_quadlet = 0x000b9900;

 private:
  void OnPlugged() override;
  void OnBusReset() override;
  std::uint32_t OnRead(std::uint64_t address, bool block, std::span<std::uint8_t> out) override;
  std::uint32_t OnWrite(std::uint64_t address, bool block,
                        std::span<const std::uint8_t> bytes) override;
  std::optional<FirewirePacket> OnCycle(std::uint64_t cycle) override;
  void OnPacket(const FirewirePacket& packet, std::uint64_t cycle) override;

  bool Streams() const { return (registers_[2] & kStreams) != 0; }
  bool MovesMotors() const { return Streams() && (armed_ || !needs_force_edge); }
  Bytes MakeState(const OmniHand& hand) const;

  std::array<std::uint8_t, 3> registers_{};  // kListenChannel, kTalkChannel, kControl
  std::array<bool, 3> written_{};
  Bytes unknown_;
  OmniStream stream_;
  Path path_;
  int step_ = 0;
  bool force_came_ = false;  // since the last packet to the host
  bool armed_ = false;       // a packet without force came since the stream began
  std::uint32_t counter_ = 0;
  std::uint64_t sent_ = 0, not_heard_ = 0;
  std::vector<OmniForcePacket> forces_;
};

}  // namespace palpate::test
