#include "server/device/omni/omni_firewire.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <utility>

#include "server/device/firewire/fw_finder.h"
#include "server/device/firewire/fw_link.h"
#include "server/device/omni/firewire_frames.h"
#include "server/device/omni/omni_serial.h"

namespace palpate {
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
constexpr milliseconds kEndTime{50};     // for the last force
constexpr milliseconds kResetTime{100};  // for each register while forces are on
constexpr std::chrono::microseconds kLook{1000};

using Frame = std::array<std::uint8_t, FwLink::kSentBytes>;
static_assert(kOmniForceBytes == FwLink::kSentBytes);

std::uint32_t Quadlet(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return value;
}

class OmniFirewireSession final : public StreamSession {
 public:
  // alone: there is no other such device on the buses.
  OmniFirewireSession(OmniArm& arm, const FwFound& found, bool alone)
      : arm_(arm), found_(found), alone_(alone), link_(found.node) {}

  std::string place() const override { return "FireWire, " + found_.node; }
  std::string identity() const override { return identity_; }
  std::string evidence() const override { return evidence_; }
  std::uint64_t transfer_errors() const override { return link_.retries(); }

  void SetUp(const std::atomic<bool>& stop) override {
    arm_.Forget();
    CheckIdentity(stop);
    const int talks_on = TakeChannels(stop);
    Configure(stop);
    link_.StartStream(
        talks_on, listens_on_, [this](const FwPacket& packet) { Take(packet); },
        EncodeOmniForce({}));
    Start(stop);
    Measure(stop);
    streams_ = true;
  }

  StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) override {
    received_ = {};
    state_ = &state;
    link_.Wait(longest);
    state_ = nullptr;
    if (link_.TakeBusReset()) {
      // Packets and channels go on; the device may have forgotten its registers. No force is sent
      // meanwhile, so this may not take long.
      ask_time_ = kResetTime;
      Configure(never_);
      Start(never_);
    }
    return received_;
  }

  bool TrySend(const DeviceCommand& command) override {
    return link_.TrySend(
        EncodeOmniForce(arm_.ForceOf(command.wrench_M.force_n, command.motors_on)));
  }

  bool LetGo() noexcept override {
    bool sent = false;
    try {
      sent = streams_ && SendLast();
      if (has_started_) {
        ask_time_ = kResetTime;
        WriteByte(kStream, 0, never_);
      }
    } catch (const BusError&) {
      // Nobody is left to get the error.
    }
    return sent;
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

  // Returns the channel of the device's packets. A device that talks already was left so by a
  // program that was killed, or another program uses it: then the channel is not free.
  int TakeChannels(const std::atomic<bool>& stop) {
    const bool talks = (link_.Read(kStream, 1, stop).front() & kStreams) != 0;
    const int old = link_.Read(kTalksOn, 1, stop).front() & 63;
    const std::uint64_t wanted = talks ? std::uint64_t{1} << old : kAllChannels;
    const std::optional<int> talks_on = link_.AllocateChannel(wanted, kFwPacketBytes, stop);
    if (!talks_on && talks) {
      throw BusError(BusFault::kBusy, "another program uses it: end that program");
    }
    const std::optional<int> listens_on =
        talks_on ? link_.AllocateChannel(kAllChannels, FwLink::kSentBytes, stop) : std::nullopt;
    if (!listens_on) {
      throw BusError(BusFault::kBusy,
                     "no free channel on the FireWire bus: end other programs that use it, or "
                     "unplug other devices");
    }
    listens_on_ = *listens_on;
    talks_on_ = *talks_on;
    return *talks_on;
  }

  void WriteByte(std::uint64_t address, int value, const std::atomic<bool>& stop) {
    link_.Write(address, std::array{static_cast<std::uint8_t>(value)}, stop, ask_time_);
  }

  void Configure(const std::atomic<bool>& stop) {
    WriteByte(kListensOn, listens_on_, stop);
    WriteByte(kTalksOn, talks_on_, stop);
    if (alone_) link_.Write(kUnknown, kUnknownValue, stop, ask_time_);
  }

  void Start(const std::atomic<bool>& stop) {
    has_started_ = true;
    WriteByte(kStream, link_.Read(kStream, 1, stop, ask_time_).front() | kStreams, stop);
  }

  // Learns how often packets come.
  void Measure(const std::atomic<bool>& stop) {
    const auto end = std::chrono::steady_clock::now() + kFirstPacketsTime;
    while (distances_.size() < kMeasuredPackets) {
      if (stop || std::chrono::steady_clock::now() > end) {
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
    const std::optional<std::uint32_t> lost = arm_.Take(*reading, *state_);
    if (!lost) return;
    received_.has_reading = true;
    ++received_.readings;
    received_.lost_readings += *lost;
  }

  // Returns true once the last zero has left.
  bool SendLast() {
    const auto end = std::chrono::steady_clock::now() + kEndTime;
    const Frame zero = EncodeOmniForce({});
    bool sent = false;
    while (std::chrono::steady_clock::now() < end) {
      if (!sent) sent = link_.TrySend(zero);
      if (sent && link_.has_sent_all()) return true;
      link_.Wait(kLook);
    }
    return false;
  }

  OmniArm& arm_;
  const FwFound found_;
  const bool alone_;
  const std::atomic<bool> never_{false};
  FwLink link_;
  std::string identity_;
  std::string evidence_;
  int listens_on_ = 0;
  int talks_on_ = 0;
  milliseconds ask_time_ = FwLink::kAskTime;
  bool has_started_ = false;
  bool streams_ = false;
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
  DeviceDescription spec = OmniArmSpec();
  spec.kind = "omni-firewire";
  spec.model = "Phantom Omni (FireWire)";
  spec.verification_level = kOmniFirewireVerification;
  if (!has_motors) spec.max_force_n = spec.continuous_force_n = 0.0;
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

std::unique_ptr<StreamSession> OmniFirewireBus::Open() {
  const std::vector<FwFound> found = FindFwNodes(kOmniVendor);
  return std::make_unique<OmniFirewireSession>(arm_, Choose(found, serial_), found.size() == 1);
}

std::string OmniFirewireBus::calibration_hint() const {
  return "not calibrated: put the stylus into its dock for a second";
}

}  // namespace palpate
