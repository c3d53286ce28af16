// Asks a Touch on USB who it is.
//
// Threads: the I/O thread of the link. Real-time: none; waits for 2 s at most.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>

#include "server/device/usb/usb_link.h"

namespace palpate {

// "serial ..., firmware ...": of both what is printable, "unknown" where nothing is.
// Throws UsbError; kTimeout where one of the two questions is not answered, or after
// `stop` is true.
std::string AskOmniUsbIdentity(UsbLink& link, const std::atomic<bool>& stop);

// The printable characters of a payload; others are one space between them.
std::string PrintableText(std::span<const std::uint8_t> payload);

}  // namespace palpate
