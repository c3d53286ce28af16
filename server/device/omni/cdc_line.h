// Sets up the serial line of a USB device of class CDC-ACM, as a host does.
//
// Threads: the I/O thread of the link. Real-time: none. Ownership: borrows the link.
// Errors: BusError. A request that the device refuses (kStall) is ignored: a line without a real
// wire does not need it.
// Source: USB Class Definitions for Communications Devices 1.2, PSTN subclass.
#pragma once

#include <cstdint>
#include <span>

#include "server/device/usb/usb_link.h"

namespace palpate {

// bInterfaceClass of the two interfaces of such a device.
inline constexpr std::uint8_t kCdcControlClass = 0x02;
inline constexpr std::uint8_t kCdcDataClass = 0x0a;

// Returns the number of the first interface of a class in a configuration descriptor (with all
// descriptors after it). Returns `otherwise` if there is none, or if the bytes are no descriptors.
std::uint8_t CdcInterface(std::span<const std::uint8_t> configuration, std::uint8_t wanted_class,
                          std::uint8_t otherwise) noexcept;

class CdcLine {
 public:
  explicit CdcLine(UsbLink& link) : link_(link) {}

  // Sets 115200 baud, 8 bits, no parity, 1 stop bit, and signals a ready terminal (DTR, RTS).
  void Open();
  // Sends a break, which resets the serial line.
  void Break();

 private:
  void Request(std::uint8_t request, std::uint16_t value, std::span<std::uint8_t> data);

  UsbLink& link_;
  std::uint8_t control_interface_ = 0;
};

}  // namespace palpate
