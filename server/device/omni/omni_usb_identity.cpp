#include "server/device/omni/omni_usb_identity.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>

#include "server/device/omni/usb_frames.h"

namespace palpate {
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

std::string AskOmniUsbIdentity(UsbLink& link, const std::atomic<bool>& stop) {
  const std::string firmware =
      Ask(link, kOmniUsbFirmwareQuery, kOmniUsbFirmwareReply, "firmware", stop);
  const std::string serial =
      Ask(link, kOmniUsbSerialQuery, kOmniUsbSerialReply, "serial number", stop);
  return "serial " + serial + ", firmware " + firmware;
}

}  // namespace palpate
