#include "tests/support/touch_emulator.h"

#include "tests/support/omni_frames.h"

namespace palpate::test {
namespace {

constexpr std::uint8_t kFirstCdcRequest = 0x20, kSendBreak = 0x23;

// Data, and then control.
UsbSpec TouchSpec() {
  return {.vendor = 0x2988,
          .product = 0x0302,
          .device_class = 2,
          .interfaces = {{.device_class = 10,
                          .endpoints = {{.address = TouchEmulator::kDataIn, .packet_bytes = 512},
                                        {.address = TouchEmulator::kDataOut, .packet_bytes = 512}},
                          .kernel_driver = "cdc_acm"},
                         {.device_class = 2,
                          .subclass = 2,
                          .protocol = 1,
                          .endpoints = {{.address = TouchEmulator::kNotify,
                                         .type = 3,
                                         .packet_bytes = 8,
                                         .interval = 9}},
                          .kernel_driver = "cdc_acm"}}};
}

}  // namespace

TouchEmulator::TouchEmulator() : EmulatedUsbDevice(TouchSpec()) {}

void TouchEmulator::OnPlugged() { parser_.Reset(); }

std::optional<std::size_t> TouchEmulator::OnControl(const UsbSetup& setup,
                                                    std::span<std::uint8_t> data) {
  if ((setup.request_type & 0x7f) != 0x21 || setup.request < kFirstCdcRequest ||
      setup.request > kSendBreak) {
    return std::nullopt;
  }
  // Line coding and line state change nothing here.
  if (setup.request == kSendBreak && break_mends) EndFaults();
  return data.size();
}

void TouchEmulator::OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) {
  if (endpoint != kDataOut) return;
  while (const auto frame = parser_.Next(bytes)) TakeFrame(frame->command);
}

void TouchEmulator::TakeFrame(std::uint8_t command) {
  if (command == kOmniUsbFirmwareQuery.command) {
    Answer(kOmniUsbFirmwareReply, "emulated 1.0");
  } else if (command == kOmniUsbSerialQuery.command) {
    Answer(kOmniUsbSerialReply, "EMULATED0001");
  }
}

// In two parts, after bytes of before.
void TouchEmulator::Answer(OmniUsbCommand reply, const std::string& text) {
  if (queries_without_answer-- > 0) return;
  Bytes payload(text.begin(), text.end());
  payload.resize(reply.payload_bytes);
  const Bytes frame = Framed(reply.command, payload);
  QueueIn(kDataIn, {1, 2, 0xa5});
  QueueIn(kDataIn, Bytes(frame.begin(), frame.begin() + 9));
  QueueIn(kDataIn, Bytes(frame.begin() + 9, frame.end()));
}

}  // namespace palpate::test
