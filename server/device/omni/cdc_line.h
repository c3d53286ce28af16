// The serial line of a USB device of class CDC-ACM, as a host sets it.
//
// Threads: the I/O thread of the link. Real-time: none. Ownership: borrows the link.
// Errors: UsbError. A request that the device refuses (kStall) is passed over: a line
// that is no wire has no need of it.
// Source: USB Class Definitions for Communications Devices 1.2, PSTN subclass.
#pragma once

#include <cstdint>
#include <span>

#include "server/device/usb/usb_link.h"

namespace palpate {

// bInterfaceClass of the two interfaces of such a device.
inline constexpr std::uint8_t kCdcControlClass = 0x02;
inline constexpr std::uint8_t kCdcDataClass = 0x0a;

// Number of the first interface of a class in a configuration descriptor with all
// that follows it; `otherwise` where there is none, or the bytes are no descriptors.
std::uint8_t CdcInterface(std::span<const std::uint8_t> configuration, std::uint8_t wanted_class,
                          std::uint8_t otherwise) noexcept;

class CdcLine {
 public:
  explicit CdcLine(UsbLink& link) : link_(link) {}

  // 115200 baud, 8 bits, no parity, 1 stop bit; the terminal is there (DTR, RTS).
  void Open();
  // A break, the serial line's call to order.
  void Break();

 private:
  void Request(std::uint8_t request, std::uint16_t value, std::span<std::uint8_t> data);

  UsbLink& link_;
  std::uint8_t control_interface_ = 0;
};

}  // namespace palpate
