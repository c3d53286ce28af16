#include "server/device/omni/omni_usb_protocol.h"

#include <algorithm>
#include <cmath>
#include <exception>

#include "common/error/error.h"
#include "server/device/omni/cdc_line.h"
#include "server/device/omni/omni_usb_identity.h"

namespace palpate {
namespace {

constexpr std::chrono::milliseconds kSendTime(500);
constexpr std::chrono::milliseconds kFarewellTime(20);

// One second. Counts farther apart belong to another count or are damaged.
constexpr std::uint32_t kLongestGap = 1000;

constexpr UsbMatch::Ids kHidTouch{0x2988, 0x0304};

bool IsQueryOrStart(std::uint8_t command) {
  const auto known = {kOmniUsbFirmwareQuery, kOmniUsbSerialQuery, kOmniUsbInit, kOmniUsbServo};
  return std::any_of(known.begin(), known.end(),
                     [=](const OmniUsbCommand& one) { return one.command == command; });
}

void Check(const OmniUsbOptions& options) {
  if (options.frames == OmniUsbFrames::kNone) return;
  const auto refuse = [](const std::string& why) {
    throw Error(ErrorKind::kInvalidArgument, "the device `omni-usb`: " + why);
  };
  if (!options.state_command || !options.force_command) {
    refuse(
        "`frames = \"framed-firewire\"` needs `state_command` and `force_command`, as learned "
        "from a capture: see deploy/guides/devices.md");
  }
  if (IsQueryOrStart(*options.force_command)) {
    refuse("`force_command` is one of the commands that start the device: it cannot carry a force");
  }
  if (*options.state_command == kOmniUsbFirmwareReply.command ||
      *options.state_command == kOmniUsbSerialReply.command) {
    refuse("`state_command` is one of the device's identity replies: it cannot carry a state");
  }
  if (!options.init_payload) {
    refuse(
        "`frames = \"framed-firewire\"` needs `init_payload`, as learned from a capture: see "
        "deploy/guides/devices.md");
  }
  for (const double counts : options.motor_counts_per_n_mm.value_or(std::array<double, 3>{})) {
    if (!(std::abs(counts) <= kOmniMaxMotorGain)) {
      refuse("`motor_counts_per_n_mm` must be from -10 to 10: more saturates the motors at once");
    }
  }
}

void SendFrame(UsbLink& link, std::uint8_t command, std::span<const std::uint8_t> payload,
               std::chrono::milliseconds time) {
  std::array<std::uint8_t, kOmniUsbMaxFrameBytes> frame{};
  link.Send(std::span(frame).first(EncodeOmniUsbFrame(command, payload, frame)), time);
}

// A process that was killed can leave the device unable to answer. A break has repaired that.
std::string Identify(UsbLink& link, const std::atomic<bool>& stop) {
  CdcLine line(link);
  line.Open();
  try {
    return AskOmniUsbIdentity(link, stop);
  } catch (const UsbError& error) {
    if (error.fault() != UsbFault::kTimeout || stop) throw;
  }
  line.Break();
  return AskOmniUsbIdentity(link, stop);
}

}  // namespace

DeviceSpec OmniUsbSpec() {
  DeviceSpec spec;
  spec.kind = "omni-usb";
  spec.model = "Phantom Omni / Geomagic Touch (USB)";
  spec.workspace_min_mm = Vec3(-80.0, -60.0, -35.0);
  spec.workspace_max_mm = Vec3(80.0, 60.0, 35.0);
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  // CHAI3D regards 0.4 to 0.7 as safe.
  spec.max_stiffness_n_per_mm = 0.5;
  spec.position_resolution_mm = 0.055;
  spec.button_count = 2;
  spec.verification_level = kOmniUsbVerification;
  return spec;
}

const std::vector<UsbMatch::Ids>& OmniUsbIds() {
  static const std::vector<UsbMatch::Ids> ids = {{0x2988, 0x0302}, kHidTouch, {0x0301, 0x2988}};
  return ids;
}

std::string OmniUsbProblem(const UsbMatch::Ids& ids) {
  return ids == kHidTouch
             ? "it is a Touch that speaks HID; its reports are not public: use it through "
               "the vendor's driver, or see deploy/guides/devices.md to capture them"
             : "";
}

OmniUsbProtocol::OmniUsbProtocol(const OmniUsbOptions& options)
    : options_(options), spec_(OmniUsbSpec()) {
  Check(options_);
  match_.ids = OmniUsbIds();
  match_.port = options_.port;
  match_.data_class = kCdcDataClass;
  match_.problem_of = OmniUsbProblem;
  if (options_.frames == OmniUsbFrames::kFramedFirewire) {
    parser_.Expect({*options_.state_command, kOmniStateBytes});
  }
}

std::string OmniUsbProtocol::SetUp(UsbLink& link, const std::atomic<bool>& stop) {
  Forget();
  const std::string identity = Identify(link, stop);
  if (options_.frames == OmniUsbFrames::kNone) {
    throw UsbError(UsbFault::kUnsuitable,
                   "on USB port " + link.found().port + " is " + identity +
                       "; its servo frames over USB are not public: see deploy/guides/devices.md "
                       "to capture them and set `frames`");
  }
  StartServo(link);
  return identity;
}

void OmniUsbProtocol::Forget() noexcept {
  parser_.Reset();
  joints_ = {};
  zero_ = {};
  calibrated_ = false;
  rest_readings_ = 0;
  calibration_wanted_ = false;
  counter_.reset();
  servo_started_ = false;
}

void OmniUsbProtocol::StartServo(UsbLink& link) {
  servo_started_ = true;  // also set if the start fails half-way
  SendFrame(link, kOmniUsbInit.command, *options_.init_payload, kSendTime);
  SendFrame(link, kOmniUsbServo.command, kOmniUsbServoOn, kSendTime);
}

UsbReceived OmniUsbProtocol::Receive(std::span<const std::uint8_t> bytes,
                                     DeviceState& state) noexcept {
  UsbReceived received;
  if (options_.frames == OmniUsbFrames::kNone) return received;
  const std::uint64_t corrupt_before = parser_.corrupt_runs();
  while (const auto frame = parser_.Next(bytes)) {
    if (frame->command != options_.state_command) continue;
    if (const auto reading = DecodeOmniState(frame->payload)) {
      // A repeated frame is no new reading: a device that hangs must become stale.
      if (reading->counter == counter_) continue;
      Take(*reading, received);
      state = StateOf(*reading);
    } else {
      ++received.corrupt_frames;
    }
  }
  received.corrupt_frames += static_cast<std::uint32_t>(parser_.corrupt_runs() - corrupt_before);
  received.has_reading = received.readings > 0;
  return received;
}

void OmniUsbProtocol::Take(const OmniState& reading, UsbReceived& received) noexcept {
  ++received.readings;
  if (counter_) {
    const std::uint32_t gap = reading.counter - *counter_;  // wraps together with the counter
    if (gap > 1 && gap <= kLongestGap) received.lost_readings += gap - 1;
  }
  counter_ = reading.counter;
  Calibrate(reading);
  std::array<std::int16_t, 3> counts{};
  for (std::size_t n = 0; n < 3; ++n) {
    // Also right if the encoder wraps: no joint turns by half of the encoder's range.
    counts[n] = static_cast<std::int16_t>(reading.encoders[n] - zero_[n]);
  }
  joints_ = OmniJointsFromCounts(counts);
}

// One frame is not enough, because frames have no checksum and the stylus may still be sliding in.
void OmniUsbProtocol::Calibrate(const OmniState& reading) noexcept {
  if (calibration_wanted_.exchange(false)) calibrated_ = false;
  if (!reading.docked || reading.encoders != docked_at_) rest_readings_ = 0;
  docked_at_ = reading.encoders;
  if (!reading.docked) return;
  rest_readings_ = std::min(rest_readings_ + 1, kOmniRestReadings);
  if (rest_readings_ < kOmniRestReadings) return;
  zero_ = reading.encoders;
  calibrated_ = true;
}

// Uses joints_, which must belong to this reading.
DeviceState OmniUsbProtocol::StateOf(const OmniState& reading) const noexcept {
  return {.p_DHip_mm = OmniPosition(joints_),
          .R_DS = OmniOrientation(joints_, reading.gimbal_rad),
          .buttons = (reading.buttons[0] ? 1u : 0u) | (reading.buttons[1] ? 2u : 0u),
          .docked = reading.docked,
          .calibrated = calibrated_};
}

std::size_t OmniUsbProtocol::Encode(const Vec3& force_D_n, bool forces_on,
                                    std::span<std::uint8_t, kMaxFrameBytes> out) noexcept {
  if (options_.frames == OmniUsbFrames::kNone) return 0;
  OmniForce force;
  if (forces_on && calibrated_) {
    if (const auto counts = MotorCounts(force_D_n)) {
      force.motors = *counts;
      force.force_enabled = true;
    }
  }
  return EncodeOmniUsbFrame(*options_.force_command, EncodeOmniForce(force), out);
}

// If a count exceeds the motors' range, all three are scaled down, so that the force keeps its
// direction.
std::optional<std::array<int, 3>> OmniUsbProtocol::MotorCounts(
    const Vec3& force_D_n) const noexcept {
  if (!options_.motor_counts_per_n_mm) return std::nullopt;
  const Vec3 torques_n_mm = OmniTorques_n_mm(joints_, force_D_n);
  const auto& gains = *options_.motor_counts_per_n_mm;
  Vec3 counts = torques_n_mm.cwiseProduct(Vec3(gains[0], gains[1], gains[2]));
  if (!counts.allFinite()) return std::nullopt;
  const double largest = counts.cwiseAbs().maxCoeff();
  if (largest > kOmniMotorRange) counts *= kOmniMotorRange / largest;
  const auto whole = [](double count) { return static_cast<int>(std::lround(count)); };
  return std::array{whole(counts[0]), whole(counts[1]), whole(counts[2])};
}

void OmniUsbProtocol::TearDown(UsbLink& link) noexcept {
  if (!servo_started_) return;
  // The second frame is sent even if the first fails.
  const auto try_to_send = [&](std::uint8_t command, std::span<const std::uint8_t> payload) {
    try {
      SendFrame(link, command, payload, kFarewellTime);
    } catch (const std::exception&) {
      // The device is gone or does not answer. Nothing more can be done.
    }
  };
  try_to_send(*options_.force_command, EncodeOmniForce({}));
  try_to_send(kOmniUsbServo.command, kOmniUsbServoOff);
}

const char* OmniUsbProtocol::calibration_hint() const noexcept {
  return "the stylus has not been seen in its holder: put it there once";
}

bool OmniUsbProtocol::RequestCalibration() noexcept {
  calibration_wanted_ = true;
  return true;
}

}  // namespace palpate
