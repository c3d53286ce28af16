#include "tests/support/omni_firewire_emulator.h"

#include <cmath>

namespace palpate::test {
namespace {

constexpr std::uint64_t kGuidUpper = 0x000b9900'00000000;
constexpr std::uint64_t kReadOnlyC0 = 0x1083, kReadOnly00 = 0x1082;
constexpr std::uint8_t kNoChannel = 0xff;
constexpr std::size_t kStateBytes = 44, kForceBytes = 16;
constexpr double kGimbalRange = 60000.0;
constexpr int kMotorZero = 0x7ff, kMotorMost = 0xfff;
constexpr unsigned kStatusBase = 0x53c0, kForceBit = 8, kLights = 3;

// Returns the place in registers_.
std::optional<std::size_t> PlaceOf(std::uint64_t address) {
  if (address == OmniFirewireEmulator::kListenChannel) return 0;
  if (address == OmniFirewireEmulator::kTalkChannel) return 1;
  if (address == OmniFirewireEmulator::kControl) return 2;
  return std::nullopt;
}

unsigned WordAt(const Bytes& bytes, std::size_t at) {
  return static_cast<unsigned>(bytes[at] | bytes[at + 1] << 8);
}

}  // namespace

OmniFirewireEmulator::OmniFirewireEmulator(std::uint32_t serial_word)
    : EmulatedFirewireDevice(kGuidUpper | serial_word) {
  SetHand({});
  OnPlugged();
}

void OmniFirewireEmulator::OnPlugged() {
  registers_ = {kNoChannel, kNoChannel, 0};
  written_ = {};
  unknown_.clear();
}

void OmniFirewireEmulator::OnBusReset() {
  if (begins_anew_at_reset) counter_ = 0;
  if (goes_deaf_at_reset) {
    registers_[0] = kNoChannel;
    written_[0] = false;
  } else if (!keeps_registers_at_reset) {
    OnPlugged();
  }
}

std::uint32_t OmniFirewireEmulator::OnRead(std::uint64_t address, bool block,
                                           std::span<std::uint8_t> out) {
  if (out.size() > 4) {
    Blame("read more than a quadlet at once");
    return RCODE_TYPE_ERROR;
  }
  if (address == kVendor || address == kSerial) {
    if (block) return RCODE_TYPE_ERROR;
    const std::uint32_t word =
        address == kVendor ? vendor_quadlet.load() : static_cast<std::uint32_t>(guid());
    for (std::size_t n = 0; n < 4; ++n) out[n] = static_cast<std::uint8_t>(word >> (24 - 8 * n));
    return RCODE_COMPLETE;
  }
  const bool is_fixed = address == kReadOnlyC0 || address == kReadOnly00;
  const auto place = PlaceOf(address);
  if (!is_fixed && (!place || address == kListenChannel)) return RCODE_ADDRESS_ERROR;
  if (!block || out.size() != 1) return RCODE_TYPE_ERROR;
  out[0] = place ? registers_[*place] : address == kReadOnlyC0 ? 0xc0 : 0x00;
  return RCODE_COMPLETE;
}

std::uint32_t OmniFirewireEmulator::OnWrite(std::uint64_t address, bool block,
                                            std::span<const std::uint8_t> bytes) {
  if (address == kUnknown) {
    if (block) return RCODE_TYPE_ERROR;
    unknown_.assign(bytes.begin(), bytes.end());
    return RCODE_COMPLETE;
  }
  const auto place = PlaceOf(address);
  if (!place) return RCODE_ADDRESS_ERROR;
  if (!block || bytes.size() != 1) return RCODE_TYPE_ERROR;
  if (address == kControl && !Streams()) armed_ = false;
  registers_[*place] = bytes[0];
  written_[*place] = true;
  return RCODE_COMPLETE;
}

std::optional<FirewirePacket> OmniFirewireEmulator::OnCycle(std::uint64_t cycle) {
  if (cycle % stream_.cycles_per_packet != 0) return std::nullopt;
  ++counter_;
  if (!Streams() || registers_[1] > 63 || stream_.silent) return std::nullopt;
  const OmniHand hand = path_(step_);
  if (force_came_) ++step_;
  force_came_ = false;
  ++sent_;
  return FirewirePacket{.channel = registers_[1], .tag = stream_.tag, .payload = MakeState(hand)};
}

Bytes OmniFirewireEmulator::MakeState(const OmniHand& hand) const {
  Bytes bytes(std::max(kStateBytes, stream_.payload_bytes));
  const auto put = [&](std::size_t at, unsigned word) {
    bytes[at] = static_cast<std::uint8_t>(word);
    bytes[at + 1] = static_cast<std::uint8_t>(word >> 8);
  };
  put(2, 0x001e);
  for (std::size_t n = 0; n < 3; ++n) {
    put(4 + 2 * n, static_cast<unsigned>(hand.encoders[n]));
    if (stream_.zero_gimbal) continue;
    const auto a = static_cast<unsigned>(std::lround(hand.gimbal[n] * kGimbalRange));
    const auto b = static_cast<unsigned>(kGimbalRange) - a;
    const unsigned noise = stream_.gimbal_noise ? (counter_ * 13 + 7 * n) & 0x1f : 0;
    put(10 + 2 * n, a ^ noise);
    put(22 + 2 * n, b ^ (noise >> 1));
  }
  bytes[18] = static_cast<std::uint8_t>(forces_.size());
  // Buttons and dock are active low.
  bytes[19] = static_cast<std::uint8_t>((~hand.pressed & 3U) | (hand.docked ? 0U : 4U));
  put(20, 0x1007);
  put(28, 0x5746);
  put(32, counter_);
  put(34, counter_ >> 16);
  put(40, counter_ / 2);
  bytes.resize(stream_.payload_bytes);
  return bytes;
}

void OmniFirewireEmulator::OnPacket(const FirewirePacket& packet, std::uint64_t cycle) {
  if (packet.channel != registers_[0]) {
    ++not_heard_;
    return;
  }
  if (packet.payload.size() != kForceBytes || packet.speed != SCODE_100 || packet.tag != 0 ||
      packet.sy != 0) {
    return Blame("sent a packet that is no force packet: length, speed, tag or sy");
  }
  OmniForcePacket force{.time_ns = NowNs(), .cycle = cycle};
  for (std::size_t n = 0; n < 3; ++n) {
    const auto word = static_cast<int>(WordAt(packet.payload, 2 * n));
    if (word > kMotorMost) Blame("sent a motor word above 0xfff");
    force.motors[n] = word - kMotorZero;
  }
  const unsigned status = WordAt(packet.payload, 6);
  if ((status & ~(kForceBit | kLights)) != kStatusBase) Blame("sent a status other than 0x53c0");
  if (std::ranges::any_of(std::span(packet.payload).subspan(8), [](auto b) { return b != 0; })) {
    Blame("sent bytes after the status");
  }
  force.force_enabled = (status & kForceBit) != 0;
  force.dock_light = status & kLights;
  if (Streams() && !force.force_enabled) armed_ = true;
  force.moved_motors = force.force_enabled && MovesMotors();
  forces_.push_back(std::move(force));
  force_came_ = true;
}

std::array<int, 3> OmniFirewireEmulator::ForceOnHand() const {
  const std::scoped_lock lock(mutex());
  const bool pushes = MovesMotors() && !forces_.empty() && forces_.back().force_enabled;
  return pushes ? forces_.back().motors : std::array<int, 3>{};
}

std::optional<std::uint8_t> OmniFirewireEmulator::Register(std::uint64_t address) const {
  const std::scoped_lock lock(mutex());
  const auto place = PlaceOf(address);
  if (!place || !written_[*place]) return std::nullopt;
  return registers_[*place];
}

}  // namespace palpate::test
