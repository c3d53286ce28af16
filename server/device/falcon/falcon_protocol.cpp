#include "server/device/falcon/falcon_protocol.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <iterator>

#include "server/device/falcon/frames.h"
#include "server/device/falcon/kinematics.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// Control requests to the FTDI chip, of type vendor, to the device.
constexpr std::uint8_t kToChip = 0x40;
constexpr std::uint8_t kReset = 0, kModemControl = 1, kFlowControl = 2, kBaudRate = 3, kData = 4,
                       kLatency = 9;
constexpr std::uint16_t kPurgeReceived = 1, kPurgeToSend = 2;
constexpr std::uint16_t kRtsLow = 0x200, kDtrLow = 0x100, kDtrHigh = 0x101;
constexpr std::uint16_t kEightBits = 8, kNoFlowControl = 0;
// Divisors of 3 MHz. The upper two bits of the 9600 baud divisor are its fraction.
constexpr std::uint16_t k1500000Baud = 2, k142857Baud = 21, k9600Baud = 0x4138;

constexpr milliseconds kPatience(1000), kPerAnswer(50), kPerGreeting(100);
constexpr int kGreetings = 20;
constexpr std::array<std::uint8_t, 3> kGreeting = {0x0a, 0x43, 0x0d};
constexpr std::array<std::uint8_t, 4> kGreetingAnswer = {0x0a, 0x44, 0x2c, 0x0d};
constexpr std::uint8_t kBegin = 0x41;
// The boot loader echoes a chunk as one packet of the chip.
constexpr std::size_t kChunkBytes = kFtdiPacketBytes - kFtdiStatusBytes;

void Request(UsbLink& link, std::uint8_t request, std::uint16_t value) {
  link.Control(kToChip, request, value, 0, {}, kPatience);
}

void Purge(UsbLink& link) {
  Request(link, kReset, kPurgeReceived);
  Request(link, kReset, kPurgeToSend);
}

void ThrowIfStopped(const std::atomic<bool>& stop) {
  if (stop) throw BusError(BusFault::kTimeout, "the program stops while it sets up the Falcon");
}

// Receives until `enough` is true for the bytes, or until `patience` is over. Returns the bytes.
template <typename Enough>
std::vector<std::uint8_t> Receive(UsbLink& link, milliseconds patience,
                                  const std::atomic<bool>& stop, Enough enough) {
  std::vector<std::uint8_t> bytes;
  std::array<std::uint8_t, 8 * kFtdiPacketBytes> transfer{};
  const auto end = Clock::now() + patience;
  while (!enough(bytes)) {
    ThrowIfStopped(stop);
    const auto left = std::chrono::ceil<milliseconds>(end - Clock::now());
    if (left <= milliseconds(0)) break;
    std::size_t size = 0;
    try {
      size = link.Receive(transfer, left);
    } catch (const BusError& error) {
      if (error.fault() != BusFault::kTimeout) throw;
    }
    ForEachFtdiByte(std::span(transfer).first(size),
                    [&](std::uint8_t byte) { bytes.push_back(byte); });
  }
  return bytes;
}

void SetLineForBootLoader(UsbLink& link) {
  Purge(link);
  Request(link, kLatency, 16);
  Request(link, kBaudRate, k9600Baud);
  Request(link, kData, kEightBits);
  Request(link, kFlowControl, kNoFlowControl);
  Request(link, kModemControl, kRtsLow);
  Request(link, kModemControl, kDtrLow);
  Request(link, kModemControl, kDtrHigh);
}

void Greet(UsbLink& link, const std::atomic<bool>& stop) {
  const auto answered = [](const std::vector<std::uint8_t>& bytes) {
    return std::search(bytes.begin(), bytes.end(), kGreetingAnswer.begin(),
                       kGreetingAnswer.end()) != bytes.end();
  };
  for (int n = 0; n < kGreetings; ++n) {
    link.Send(kGreeting, kPatience);
    if (answered(Receive(link, kPerGreeting, stop, answered))) return;
  }
  throw BusError(BusFault::kTimeout,
                 "the Falcon's boot loader does not answer: unplug its power and its USB cable, "
                 "and plug them in again");
}

// Sends bytes and compares the boot loader's echo.
void SendAndCompare(UsbLink& link, std::span<const std::uint8_t> bytes,
                    const std::atomic<bool>& stop) {
  link.Send(bytes, kPatience);
  const auto back = Receive(link, kPatience, stop, [&](const std::vector<std::uint8_t>& got) {
    return got.size() >= bytes.size();
  });
  if (!std::equal(bytes.begin(), bytes.end(), back.begin(), back.end())) {
    throw BusError(back.size() < bytes.size() ? BusFault::kTimeout : BusFault::kCorrupt,
                   "the Falcon did not take its firmware: unplug its power and its USB cable, and "
                   "plug them in again");
  }
}

// Sets 1.5 Mbaud and 1 ms of latency, and clears the chip's buffers.
void SetFalconLineForFrames(UsbLink& link) {
  Request(link, kLatency, 1);
  Request(link, kBaudRate, k1500000Baud);
  Purge(link);
}

// Sends commands without a force until a report comes, at most `tries` times.
bool FalconAnswers(UsbLink& link, int tries, const std::atomic<bool>& stop) {
  FalconFrameFinder finder;
  for (int n = 0; n < tries; ++n) {
    link.Send(EncodeFalconCommand({}), kPatience);
    bool found = false;
    std::size_t seen = 0;
    Receive(link, kPerAnswer, stop, [&](const std::vector<std::uint8_t>& bytes) {
      for (; seen < bytes.size(); ++seen) found = finder.Push(bytes[seen]) || found;
      return found;
    });
    if (found) return true;
  }
  return false;
}

// Uploads through the boot loader, which echoes each byte. Takes seconds. Afterwards the line is
// set up for frames.
void UploadFalconFirmware(UsbLink& link, std::span<const std::uint8_t> firmware,
                          const std::atomic<bool>& stop) {
  SetLineForBootLoader(link);
  Greet(link, stop);
  Request(link, kModemControl, kDtrLow);
  Request(link, kBaudRate, k142857Baud);
  SendAndCompare(link, std::span(&kBegin, 1), stop);
  for (std::size_t at = 0; at < firmware.size(); at += kChunkBytes) {
    SendAndCompare(link, firmware.subspan(at, std::min(kChunkBytes, firmware.size() - at)), stop);
  }
  SetFalconLineForFrames(link);
}

}  // namespace

std::vector<std::uint8_t> ReadFalconFirmware(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<std::uint8_t> bytes;
  char byte = 0;
  while (bytes.size() <= kMaxFalconFirmwareBytes && in.get(byte)) {
    bytes.push_back(static_cast<std::uint8_t>(byte));
  }
  if (bytes.empty() || bytes.size() > kMaxFalconFirmwareBytes) {
    throw BusError(BusFault::kUnsuitable, "the Falcon's firmware cannot be read from " + file +
                                              (bytes.empty() ? ": it is missing, forbidden or empty"
                                                             : ": it is too long"));
  }
  return bytes;
}

namespace {

constexpr UsbMatch::Ids kIds{.vendor = 0x0403, .product = 0xcb48};
constexpr std::uint8_t kVendorClass = 0xff;  // class of the FTDI chip's only interface
constexpr int kTries = 10, kTriesAfterUpload = 40;
constexpr std::chrono::milliseconds kSendPatience(100);

DeviceDescription FalconSpec() {
  DeviceDescription spec;
  spec.kind = "falcon";
  spec.model = "Novint Falcon";
  // The datasheet's 4 inch cube. The corners of the cube are out of reach (kinematics.h).
  spec.workspace_min_mm = Vec3::Constant(-50.8);
  spec.workspace_max_mm = Vec3::Constant(50.8);
  // The datasheet says more than 2 lb (8.9 N), CHAI3D says 8 N. We limit it to 3.3 N, as all forces
  // here, until the force of a motor count is measured.
  spec.max_force_n = 3.3;
  // The value is not published. We use the value of the Touch, whose motors have a third of the
  // force: a cautious guess.
  spec.continuous_force_n = 0.88;
  // CHAI3D uses 3 N/mm. We use a third of it, because the Falcon is untried with this servo.
  spec.max_stiffness_n_per_mm = 1.0;
  spec.position_resolution_mm = 25.4 / 400.0;  // the datasheet's 400 per inch
  spec.button_count = 4;
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

}  // namespace

FalconProtocol::FalconProtocol(const FalconOptions& options)
    : spec_(FalconSpec()),
      match_{.ids = {kIds}, .port = options.port, .data_class = kVendorClass},
      firmware_file_(options.firmware_file) {}

std::string FalconProtocol::SetUp(UsbLink& link, const std::atomic<bool>& stop) {
  finder_ = {};
  calibrated_ = false;
  p_M_mm_ = angles_rad_ = Vec3::Zero();
  SetFalconLineForFrames(link);
  if (!FalconAnswers(link, kTries, stop)) {
    if (firmware_file_.empty()) {
      throw BusError(BusFault::kUnsuitable,
                     "the Falcon does not answer: it has no firmware yet; set [device] "
                     "falcon_firmware to the file of Novint's firmware, which is part of Novint's "
                     "driver and of libnifalcon");
    }
    UploadFalconFirmware(link, ReadFalconFirmware(firmware_file_), stop);
    if (!FalconAnswers(link, kTriesAfterUpload, stop)) {
      throw BusError(BusFault::kTimeout, "the Falcon took the firmware from " + firmware_file_ +
                                             " and does not answer: is it Novint's?");
    }
  }
  return "Novint Falcon at USB port " + link.found().port;
}

StreamReceived FalconProtocol::Receive(std::span<const std::uint8_t> bytes,
                                       DeviceState& state) noexcept {
  StreamReceived received;
  const std::uint32_t corrupt_before = finder_.corrupt_frames();
  FalconFrame newest{};
  ForEachFtdiByte(bytes, [&](std::uint8_t byte) {
    if (!finder_.Push(byte)) return;
    newest = finder_.frame();
    ++received.readings;
  });
  received.corrupt_frames = finder_.corrupt_frames() - corrupt_before;
  const auto report = DecodeFalconReport(newest);
  if (!report) return received;
  received.has_reading = true;
  Understand(*report, state);
  return received;
}

void FalconProtocol::Understand(const FalconReport& report, DeviceState& state) noexcept {
  const Vec3 angles_rad = FalconAnglesFromCounts(report.encoders);
  calibrated_ = report.is_homed() && FalconPositionAt(angles_rad, p_M_mm_);
  if (calibrated_) angles_rad_ = angles_rad;
  state.p_MHip_mm = p_M_mm_;
  state.R_MS = Eigen::Quaterniond::Identity();
  state.buttons = report.buttons;
  state.docked = false;
  state.calibrated = calibrated_;
}

std::size_t FalconProtocol::Encode(const DeviceCommand& command,
                                   std::span<std::uint8_t, kMaxFrameBytes> out) noexcept {
  // The homing flag stays set: libnifalcon's programs never clear it.
  FalconCommand motors{.lights = kFalconRedLight, .homing = true};
  if (calibrated_) motors.lights = command.motors_on ? kFalconGreenLight : kFalconBlueLight;
  Mat3 jacobian;
  if (calibrated_ && command.motors_on && FalconJacobianAt(p_M_mm_, angles_rad_, jacobian)) {
    motors.motors = FalconMotorsFromTorques(jacobian.transpose() * command.wrench_M.force_n);
  }
  const FalconFrame frame = EncodeFalconCommand(motors);
  std::copy(frame.begin(), frame.end(), out.begin());
  return frame.size();
}

void FalconProtocol::TearDown(UsbLink& link) noexcept {
  try {
    link.Send(EncodeFalconCommand({.homing = true}), kSendPatience);
  } catch (const BusError&) {
    // The device is gone, and its force with it.
  }
}

const char* FalconProtocol::calibration_hint() const noexcept {
  return "the Falcon is not homed: pull its grip all the way out, then push it all the way in";
}

}  // namespace palpate
