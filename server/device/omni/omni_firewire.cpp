#include "server/device/omni/omni_firewire.h"

#include <fmt/core.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <utility>

#include "server/device/firewire/fw_link.h"
#include "server/device/firewire/fw_node.h"
#include "server/device/omni/omni_frames.h"
#include "server/realtime/tick_timer.h"

namespace palpate {

std::string OmniSerialOf(std::uint64_t guid) {
  const auto bits = [&](int lowest, int count) { return guid >> lowest & ((1u << count) - 1); };
  return fmt::format("{}{:02}{:02}{}{:05}", bits(23, 3), bits(19, 4), bits(14, 5), bits(11, 3),
                     bits(1, 10));
}

namespace {

using std::chrono::milliseconds;

// Registers of one byte, except for those with another size.
constexpr std::uint64_t kListensOn = 0x1000;  // a channel
constexpr std::uint64_t kTalksOn = 0x1001;    // a channel
constexpr std::uint64_t kStream = 0x1087;
constexpr std::uint64_t kUnknown = 0x20010;    // 4 bytes
constexpr std::uint64_t kVendor = 0x1006000c;  // 4 bytes
constexpr std::uint64_t kSerial = 0x10060010;  // 4 bytes: the lower word of the GUID

constexpr std::uint8_t kStreams = 0x08;  // a bit of kStream
constexpr std::array<std::uint8_t, 4> kVendorValue = {0x00, 0x0b, 0x99, 0x00};
// Two of the drivers say that the device needs it. With two devices on the bus, the third saw that
// it disturbs the packets.
constexpr std::array<std::uint8_t, 4> kUnknownValue = {0x00, 0x00, 0x0f, 0xf8};

constexpr std::uint64_t kAllChannels = ~std::uint64_t{0};
constexpr std::size_t kMeasuredPackets = 64;
constexpr int kCyclesPerMs = 8;
constexpr milliseconds kFirstPacketsTime{500};
constexpr milliseconds kEndTime{50};  // for the last force, and for the stop
constexpr std::chrono::microseconds kLook{1000};

using Clock = std::chrono::steady_clock;
using Frame = std::array<std::uint8_t, FwLink::kSentBytes>;
static_assert(kOmniForceBytes == FwLink::kSentBytes);

struct Register {
  std::uint64_t address = 0;
  std::vector<std::uint8_t> value{};
};

std::uint32_t Quadlet(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return value;
}

class OmniFirewireSession final : public StreamSession {
 public:
  OmniFirewireSession(OmniArm& arm, const FwFound& found)
      : arm_(arm), found_(found), link_(found.node) {}

  std::string place() const override { return "FireWire, " + found_.node; }
  std::string identity() const override { return identity_; }
  std::string evidence() const override { return evidence_; }
  std::uint64_t transfer_errors() const override { return link_.retries(); }

  void SetUp(const std::atomic<bool>& stop) override {
    arm_.Forget();
    CheckIdentity(stop);
    TakeChannels(stop);
    link_.StartStream(
        talks_on_, listens_on_, [this](const FwPacket& packet) { Take(packet); },
        EncodeOmniForce({}));
    talks_ = starts_ = true;
    for (const Register& one : Registers()) {
      link_.Write(one.address, one.value, stop);
      link_.TrySend(EncodeOmniForce({}));  // the force of a program that was killed ends here
    }
    Measure(stop);
    streams_ = true;
  }

  StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) override {
    received_ = {};
    state_ = &state;
    link_.Wait(longest);
    if (link_.has_lost_a_channel()) {
      throw BusError(BusFault::kBroken, "the FireWire bus took a channel back after a bus reset");
    }
    Restore();
    return received_;
  }

  bool TrySend(const DeviceCommand& command) override {
    if (link_.is_stuck()) {
      throw BusError(BusFault::kTimeout, "no force leaves the FireWire controller");
    }
    return link_.TrySend(
        EncodeOmniForce(arm_.ForceOf(command.wrench_M.force_n, command.motors_on)));
  }

  // Each step is tried, whatever became of the one before: the second ends a force, too.
  bool LetGo() noexcept override {
    state_ = nullptr;  // its owner may be gone
    bool is_off = false;
    try {
      // A zero that the device does not hear is none.
      const bool hears = streams_ && to_write_.empty();
      is_off = starts_ && SendLast() && hears && !link_.TakeBusReset();
    } catch (const BusError&) {
    }
    try {
      if (talks_) {
        link_.Write(kStream, std::array<std::uint8_t, 1>{0}, never_,
                    is_off ? kEndTime : 4 * kEndTime);
        is_off = true;
      }
    } catch (const BusError&) {
    }
    link_.StopStream();
    return is_off;
  }

 private:
  void CheckIdentity(const std::atomic<bool>& stop) {
    const std::vector<std::uint8_t> vendor = link_.Read(kVendor, kVendorValue.size(), stop);
    if (!std::ranges::equal(vendor, kVendorValue)) {
      throw BusError(BusFault::kUnsuitable,
                     "found on FireWire at " + found_.node +
                         ", but its registers are not those of a Phantom Omni");
    }
    const std::uint32_t word = Quadlet(link_.Read(kSerial, 4, stop));
    if (word != static_cast<std::uint32_t>(found_.guid)) {
      throw BusError(BusFault::kCorrupt, "it tells another serial number than the bus does");
    }
  }

  // A device that talks already was left so by a program that was killed, or another program uses
  // it: then its channel is not free.
  void TakeChannels(const std::atomic<bool>& stop) {
    stream_value_ = link_.Read(kStream, 1, stop).front();
    const bool talked = (stream_value_ & kStreams) != 0;
    const int old = link_.Read(kTalksOn, 1, stop).front() & 63;
    const std::uint64_t wanted = talked ? std::uint64_t{1} << old : kAllChannels;
    const std::optional<int> talks_on = link_.AllocateChannel(wanted, kFwPacketBytes, stop);
    if (!talks_on && talked) {
      throw BusError(BusFault::kBusy,
                     "another program uses it: end that program, or switch the device off and on");
    }
    talks_ = talked && talks_on;  // nobody else ends its force
    const std::optional<int> listens_on =
        talks_on ? link_.AllocateChannel(kAllChannels, FwLink::kSentBytes, stop) : std::nullopt;
    if (!listens_on) {
      throw BusError(BusFault::kBusy,
                     "no free channel on the FireWire bus: end other programs that use it, or "
                     "unplug other devices");
    }
    listens_on_ = *listens_on;
    talks_on_ = *talks_on;
  }

  // What tells the device its channels and starts it, in this order.
  std::vector<Register> Registers() const {
    std::vector<Register> all = {{kListensOn, {static_cast<std::uint8_t>(listens_on_)}},
                                 {kTalksOn, {static_cast<std::uint8_t>(talks_on_)}}};
    if (FindFwNodes(kOmniVendor).size() == 1) {
      all.push_back({kUnknown, {kUnknownValue.begin(), kUnknownValue.end()}});
    }
    all.push_back({kStream, {static_cast<std::uint8_t>(stream_value_ | kStreams)}});
    return all;
  }

  // After a bus reset packets and channels go on, but the device may have forgotten its registers.
  // Writes them again, while readings and forces go on.
  void Restore() {
    if (link_.TakeBusReset()) {
      checks_counter_ = true;
      to_write_ = Registers();
      restore_end_ = Clock::now() + FwLink::kAskTime;
      link_.BeginWrite(to_write_.front().address, to_write_.front().value);
    }
    if (to_write_.empty()) return;
    received_.restarted = true;  // it may not hear what is sent
    const FwLink::Answer answer = link_.answer();
    if (answer == FwLink::Answer::kNone) return;
    if (Clock::now() > restore_end_) {
      throw BusError(BusFault::kTimeout, "it does not take its registers after a bus reset");
    }
    if (answer == FwLink::Answer::kDone) to_write_.erase(to_write_.begin());
    if (!to_write_.empty()) {
      link_.BeginWrite(to_write_.front().address, to_write_.front().value);
    }
  }

  // Learns how often packets come.
  void Measure(const std::atomic<bool>& stop) {
    const auto end = Clock::now() + kFirstPacketsTime;
    while (distances_.size() < kMeasuredPackets) {
      if (stop || Clock::now() > end) {
        throw BusError(BusFault::kTimeout, "it sends no packets; switch it off and on again");
      }
      link_.Wait(kLook);
    }
    std::ranges::nth_element(distances_, distances_.begin() + kMeasuredPackets / 2);
    const int distance = std::max(distances_[kMeasuredPackets / 2], 1);
    link_.SetPacketsPerEvent(std::clamp(kCyclesPerMs / distance, 1, kCyclesPerMs));
    identity_ = fmt::format("serial number {}, packets of {} bytes, {} per second",
                            OmniSerialOf(found_.guid), packet_bytes_, 8000 / distance);
  }

  void Take(const FwPacket& packet) {
    if (packet_bytes_ == 0) {
      evidence_ = fmt::format("its first packet: {:02x}", fmt::join(packet.payload, " "));
    }
    packet_bytes_ = packet.length;
    if (distances_.size() < kMeasuredPackets) {
      if (last_cycle_) {
        distances_.push_back((packet.cycle - *last_cycle_ + kFwCycles) % kFwCycles);
      }
      last_cycle_ = packet.cycle;
    }
    if (state_ == nullptr) return;
    const std::optional<OmniState> reading =
        packet.length <= kFwPacketBytes ? DecodeOmniState(packet.payload) : std::nullopt;
    if (!reading) {
      ++received_.corrupt_frames;
      return;
    }
    // Encoders of a device that began anew count from elsewhere.
    if (std::exchange(checks_counter_, false) && !arm_.Continues(*reading)) arm_.Forget();
    const std::optional<std::uint32_t> lost = arm_.Take(*reading, *state_);
    if (!lost) return;
    received_.has_reading = true;
    received_.time_ns = MonotonicNowNs();
    ++received_.readings;
    received_.lost_readings += *lost;
  }

  // Returns true once the last zero has left.
  bool SendLast() {
    const auto end = Clock::now() + kEndTime;
    const Frame zero = EncodeOmniForce({});
    bool sent = false;
    while (Clock::now() < end) {
      if (!sent) sent = link_.TrySend(zero);
      if (sent && link_.has_sent_all()) return true;
      link_.Wait(kLook);
    }
    return false;
  }

  OmniArm& arm_;
  const FwFound found_;
  const std::atomic<bool> never_{false};
  FwLink link_;
  std::string identity_;
  std::string evidence_;
  int listens_on_ = 0;
  int talks_on_ = 0;
  std::uint8_t stream_value_ = 0;  // of kStream before it was started
  bool talks_ = false;             // the device sends packets, or may
  bool streams_ = false, starts_ = false;
  std::vector<Register> to_write_;  // since a bus reset
  bool checks_counter_ = false;     // of the next reading
  Clock::time_point restore_end_{};
  std::size_t packet_bytes_ = 0;
  std::optional<int> last_cycle_;
  std::vector<int> distances_;  // between packets, in cycles, until they are measured
  StreamReceived received_;     // in this Wait
  DeviceState* state_ = nullptr;
};

const FwFound& Choose(const std::vector<FwFound>& found, const std::string& serial) {
  if (found.empty()) {
    const std::string problem = OmniFirewireProblem();
    throw BusError(BusFault::kAbsent,
                   "not found: " + (problem.empty() ? "plug it in and switch it on" : problem));
  }
  std::string serials;
  for (const FwFound& one : found) {
    if (OmniSerialOf(one.guid) == serial) return one;
    serials += (serials.empty() ? "" : ", ") + OmniSerialOf(one.guid);
  }
  if (!serial.empty()) {
    throw BusError(BusFault::kAbsent,
                   "not found with serial number " + serial + ": on the bus are " + serials);
  }
  if (found.size() > 1) {
    throw BusError(BusFault::kAmbiguous, "several are plugged in, with the serial numbers " +
                                             serials + ": set [device] serial to one of them");
  }
  return found.front();
}

}  // namespace

DeviceDescription OmniFirewireSpec(bool has_motors) {
  DeviceDescription spec = OmniArmSpec(has_motors);
  spec.kind = "omni-firewire";
  spec.model = "Phantom Omni (FireWire)";
  spec.verification_level = kOmniFirewireVerification;
  return spec;
}

std::string OmniFirewireProblem() {
  if (HasFwController()) return "";
  return "this machine has no FireWire controller, or its driver firewire_ohci is not loaded";
}

OmniFirewireBus::OmniFirewireBus(const OmniFirewireOptions& options)
    : serial_(options.serial),
      spec_(OmniFirewireSpec(options.motor_counts_per_n_mm.has_value())),
      arm_(options.motor_counts_per_n_mm) {}

std::unique_ptr<StreamSession> OmniFirewireBus::Open(const std::atomic<bool>& /*stop*/) {
  const std::vector<FwFound> found = FindFwNodes(kOmniVendor);
  return std::make_unique<OmniFirewireSession>(arm_, Choose(found, serial_));
}

std::string OmniFirewireBus::calibration_hint() const {
  return "not calibrated: put the stylus into its dock for a second";
}

}  // namespace palpate
