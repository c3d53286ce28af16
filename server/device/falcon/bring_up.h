// Brings a Falcon to the state in which it speaks frames: sets up its FTDI chip, and uploads the
// firmware, which the Falcon loses without power.
//
// Source: libnifalcon (BSD), FalconCommLibUSB.cpp and FalconFirmware.cpp. Verification level: none;
// we have not seen a device.
// Threads: the I/O thread. Not real-time: waits.
// Errors: BusError, also soon after `stop` becomes true.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "server/device/usb/usb_link.h"

namespace palpate {

// Sets 1.5 Mbaud and 1 ms of latency, and clears the chip's buffers.
void SetFalconLineForFrames(UsbLink& link);

// Sends commands without a force until a report comes, at most `tries` times.
bool FalconAnswers(UsbLink& link, int tries, const std::atomic<bool>& stop);

// Reads the operator's file, of 1 byte to kMaxFalconFirmwareBytes.
inline constexpr std::size_t kMaxFalconFirmwareBytes = 256 * 1024;
std::vector<std::uint8_t> ReadFalconFirmware(const std::string& file);

// Uploads through the boot loader, which echoes each byte. Takes seconds. Afterwards the line is
// set up for frames.
void UploadFalconFirmware(UsbLink& link, std::span<const std::uint8_t> firmware,
                          const std::atomic<bool>& stop);

}  // namespace palpate
