#include "server/device/omni/cdc_line.h"

#include <array>
#include <chrono>
#include <thread>

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

}  // namespace palpate
