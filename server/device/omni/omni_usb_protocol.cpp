#include "server/device/omni/omni_usb_protocol.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <thread>

#include "server/device/omni/omni_arm.h"
#include "server/device/omni/omni_frames.h"

namespace palpate {
namespace {

constexpr std::chrono::milliseconds kTimeout(200);

constexpr std::uint8_t kFromDevice = 0x80, kGetDescriptor = 0x06;
constexpr std::uint16_t kConfiguration = 0x0200;
constexpr std::uint8_t kToClassInterface = 0x21;
constexpr std::uint8_t kSetLineCoding = 0x20, kSetControlLineState = 0x22, kSendBreak = 0x23;
constexpr std::uint16_t kDtrAndRts = 0x03;
constexpr std::uint16_t kBreakMs = 100;

constexpr std::uint8_t kInterfaceDescriptor = 0x04;
constexpr std::size_t kInterfaceDescriptorBytes = 9;

}  // namespace

std::uint8_t CdcInterface(std::span<const std::uint8_t> configuration, std::uint8_t wanted_class,
                          std::uint8_t otherwise) noexcept {
  while (configuration.size() >= 2) {
    const std::size_t length = configuration[0];
    if (length < 2 || length > configuration.size()) break;
    if (configuration[1] == kInterfaceDescriptor && length >= kInterfaceDescriptorBytes &&
        configuration[5] == wanted_class) {
      return configuration[2];
    }
    configuration = configuration.subspan(length);
  }
  return otherwise;
}

void CdcLine::Open() {
  // Nearly always interface 0. If the device does not give its descriptors, 0 is assumed.
  std::array<std::uint8_t, 512> descriptors{};
  std::size_t bytes = 0;
  try {
    bytes = link_.Control(kFromDevice, kGetDescriptor, kConfiguration, 0, descriptors, kTimeout);
  } catch (const BusError& error) {
    if (error.fault() == BusFault::kAbsent) throw;
  }
  control_interface_ = CdcInterface(std::span(descriptors).first(bytes), kCdcControlClass, 0);

  constexpr std::uint32_t kBaud = 115200;
  std::array<std::uint8_t, 7> coding = {kBaud & 0xff, kBaud >> 8 & 0xff, kBaud >> 16, 0, 0, 0, 8};
  Request(kSetLineCoding, 0, coding);
  Request(kSetControlLineState, kDtrAndRts, {});
}

void CdcLine::Break() {
  Request(kSendBreak, kBreakMs, {});
  // The device ends the break by itself. Bytes sent before that are lost.
  std::this_thread::sleep_for(std::chrono::milliseconds(2 * kBreakMs));
}

void CdcLine::Request(std::uint8_t request, std::uint16_t value, std::span<std::uint8_t> data) {
  try {
    link_.Control(kToClassInterface, request, value, control_interface_, data, kTimeout);
  } catch (const BusError& error) {
    if (error.fault() != BusFault::kStall) throw;
  }
}

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kAnswerTime(500);
constexpr int kTries = 2;
constexpr milliseconds kSlice(50);  // how often `stop` is checked
// A multiple of every bulk endpoint's packet, so that no packet overflows it.
constexpr std::size_t kTransferBytes = 512;

std::size_t ReceiveWithin(UsbLink& link, std::span<std::uint8_t> bytes, milliseconds time) {
  try {
    return link.Receive(bytes, time);
  } catch (const BusError& error) {
    if (error.fault() != BusFault::kTimeout) throw;
    return 0;
  }
}

// Returns the answer's payload as text. Ignores other frames: a device that was left running may
// still stream.
std::optional<std::string> AwaitAnswer(UsbLink& link, std::uint8_t reply,
                                       const std::atomic<bool>& stop) {
  OmniUsbParser parser;
  std::array<std::uint8_t, kTransferBytes> bytes{};
  const auto end = steady_clock::now() + kAnswerTime;
  while (!stop && steady_clock::now() < end) {
    std::span<const std::uint8_t> left = std::span(bytes).first(ReceiveWithin(link, bytes, kSlice));
    while (const auto frame = parser.Next(left)) {
      if (frame->command == reply) return PrintableText(frame->payload);
    }
  }
  return std::nullopt;
}

std::string Ask(UsbLink& link, OmniUsbCommand query, OmniUsbCommand reply, const char* what,
                const std::atomic<bool>& stop) {
  const std::array<std::uint8_t, kOmniUsbMaxPayloadBytes> zeros{};
  std::array<std::uint8_t, kOmniUsbMaxFrameBytes> frame{};
  const std::size_t bytes =
      EncodeOmniUsbFrame(query.command, std::span(zeros).first(query.payload_bytes), frame);
  for (int n = 0; n < kTries && !stop; ++n) {
    try {
      link.Send(std::span(frame).first(bytes), kAnswerTime);
    } catch (const BusError& error) {
      if (error.fault() != BusFault::kTimeout) throw;
      continue;
    }
    if (auto answer = AwaitAnswer(link, reply.command, stop)) return *answer;
  }
  throw BusError(BusFault::kTimeout, "on USB port " + link.found().port +
                                         " the device does not tell its " + what +
                                         ": unplug it and plug it in again");
}

// Returns "serial ..., firmware ...", each with its printable characters, or "unknown" if there are
// none. Throws BusError: kTimeout if one of the two questions is not answered, or once `stop` is
// true.
std::string AskOmniUsbIdentity(UsbLink& link, const std::atomic<bool>& stop) {
  const std::string firmware =
      Ask(link, kOmniUsbFirmwareQuery, kOmniUsbFirmwareReply, "firmware", stop);
  const std::string serial =
      Ask(link, kOmniUsbSerialQuery, kOmniUsbSerialReply, "serial number", stop);
  return "serial " + serial + ", firmware " + firmware;
}

}  // namespace

std::string PrintableText(std::span<const std::uint8_t> payload) {
  std::string text;
  for (const std::uint8_t byte : payload) {
    if (byte > ' ' && byte < 0x7f) {
      text += static_cast<char>(byte);
    } else if (!text.empty() && text.back() != ' ') {
      text += ' ';
    }
  }
  if (!text.empty() && text.back() == ' ') text.pop_back();
  return text.empty() ? "unknown" : text;
}

namespace {

constexpr UsbMatch::Ids kHidTouch{0x2988, 0x0304};

constexpr char kOnlyIdentified[] =
    "this kind only identifies the device: nothing is decoded and no force is sent; use "
    "`openhaptics` for a Touch on USB, `omni-firewire` for a Phantom Omni on FireWire";

// Why a device is not even asked who it is; "": it is.
std::string WhyNotAsked(const UsbMatch::Ids& ids) {
  return ids == kHidTouch
             ? "it is a Touch that speaks HID; its reports are not public: use it through "
               "the vendor's driver (`openhaptics`), or see deploy/guides/devices.md to capture "
               "them"
             : "";
}

// A process that was killed can leave the device unable to answer. A break has repaired that.
std::string Identify(UsbLink& link, const std::atomic<bool>& stop) {
  CdcLine line(link);
  line.Open();
  try {
    return AskOmniUsbIdentity(link, stop);
  } catch (const BusError& error) {
    if (error.fault() != BusFault::kTimeout || stop) throw;
  }
  line.Break();
  return AskOmniUsbIdentity(link, stop);
}

}  // namespace

DeviceDescription OmniUsbSpec() {
  DeviceDescription spec = OmniArmSpec(false);
  spec.kind = "omni-usb";
  spec.model =
      "Phantom Omni / Geomagic Touch (USB), only identified: use openhaptics or omni-firewire";
  spec.button_count = 0;
  spec.senses_orientation = false;
  spec.verification_level = kOmniUsbVerification;
  return spec;
}

const std::vector<UsbMatch::Ids>& OmniUsbIds() {
  static const std::vector<UsbMatch::Ids> ids = {{0x2988, 0x0302}, kHidTouch, {0x0301, 0x2988}};
  return ids;
}

std::string OmniUsbProblem(const UsbMatch::Ids& ids) {
  const std::string problem = WhyNotAsked(ids);
  return problem.empty() ? kOnlyIdentified : problem;
}

std::string OmniUsbNotFound() {
  std::string text = "not found; ";
  return text += kOnlyIdentified;
}

OmniUsbProtocol::OmniUsbProtocol(const std::string& port) : spec_(OmniUsbSpec()) {
  match_.ids = OmniUsbIds();
  match_.port = port;
  match_.data_class = kCdcDataClass;
  match_.problem_of = WhyNotAsked;
}

std::string OmniUsbProtocol::SetUp(UsbLink& link, const std::atomic<bool>& stop) {
  throw BusError(BusFault::kUnsuitable,
                 "on USB port " + link.found().port + " is " + Identify(link, stop) +
                     "; its servo frames over USB are not public: use it through the vendor's "
                     "driver (`openhaptics`), or see deploy/guides/devices.md to capture them");
}

}  // namespace palpate
