// Asks a Touch on USB for its serial number and firmware.
//
// Threads: the I/O thread of the link. Not real-time: waits for at most 2 s.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>

#include "server/device/usb/usb_link.h"

namespace palpate {

// Returns "serial ..., firmware ...", each with its printable characters, or "unknown" if there are
// none. Throws BusError: kTimeout if one of the two questions is not answered, or once `stop` is
// true.
std::string AskOmniUsbIdentity(UsbLink& link, const std::atomic<bool>& stop);

// Returns the printable characters of a payload, with one space for each run of other bytes between
// them. Returns "unknown" if there are none.
std::string PrintableText(std::span<const std::uint8_t> payload);

}  // namespace palpate
