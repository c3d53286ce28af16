// How a Falcon is brought to where it speaks frames: its FTDI chip's settings, and the
// firmware, which it forgets without power.
//
// Source: libnifalcon (BSD), FalconCommLibUSB.cpp and FalconFirmware.cpp. Verification
// level: none; we have not seen a device.
// Threads: the I/O thread. Real-time: none; waits.
// Errors: UsbError, also soon after `stop` is true.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "server/device/usb/usb_link.h"

namespace palpate {

// 1.5 Mbaud, 1 ms of latency, nothing left of before.
void SetFalconLineForFrames(UsbLink& link);

// Sends commands without a force until a report comes, `tries` times at most.
bool FalconAnswers(UsbLink& link, int tries, const std::atomic<bool>& stop);

// Of a file of the operator: 1 byte to kMaxFalconFirmwareBytes.
inline constexpr std::size_t kMaxFalconFirmwareBytes = 256 * 1024;
std::vector<std::uint8_t> ReadFalconFirmware(const std::string& file);

// Through the boot loader, which says each byte back. Takes seconds. The line is left
// as for frames.
void UploadFalconFirmware(UsbLink& link, std::span<const std::uint8_t> firmware,
                          const std::atomic<bool>& stop);

}  // namespace palpate
