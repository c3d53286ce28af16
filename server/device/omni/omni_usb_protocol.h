// The Phantom Omni / Geomagic Touch on USB: says who it is, and that it cannot be driven.
//
// The framing of the serial line and the identity queries come from one published trace
// (omni_frames.h). The servo frames over USB are not public: nothing is decoded, and nothing is
// sent after the queries.
//
// Verification level of all of it: none. We have not seen a device.
//
// Threads, real-time: as UsbProtocol. Errors: BusError from SetUp.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "server/device/usb/usb_bus.h"
#include "server/device/usb/usb_link.h"

namespace palpate {

// bInterfaceClass of the two interfaces of such a device.
inline constexpr std::uint8_t kCdcControlClass = 0x02;
inline constexpr std::uint8_t kCdcDataClass = 0x0a;

// Returns the number of the first interface of a class in a configuration descriptor (with all
// descriptors after it). Returns `otherwise` if there is none, or if the bytes are no descriptors.
std::uint8_t CdcInterface(std::span<const std::uint8_t> configuration, std::uint8_t wanted_class,
                          std::uint8_t otherwise) noexcept;

// Sets up the serial line of a USB device of class CDC-ACM, as a host does.
//
// Threads: the I/O thread of the link. Real-time: none. Ownership: borrows the link.
// Errors: BusError. A request that the device refuses (kStall) is ignored: a line without a real
// wire does not need it.
// Source: USB Class Definitions for Communications Devices 1.2, PSTN subclass.
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

// Asks a Touch on USB for its serial number and firmware.
//
// Threads: the I/O thread of the link. Not real-time: waits for at most 2 s.

// Returns the printable characters of a payload, with one space for each run of other bytes between
// them. Returns "unknown" if there are none.
std::string PrintableText(std::span<const std::uint8_t> payload);

// What we have seen of this device on hardware. Raise it one step at a time, with the evidence that
// deploy/guides/devices.md asks for.
inline constexpr VerificationLevel kOmniUsbVerification = VerificationLevel::kNone;

// The spec of the device, also without a device. It has what works: no force, no buttons, and a
// model that names the kinds to use instead.
DeviceDescription OmniUsbSpec();

// OmniUsbIds: the ids of all known devices. OmniUsbProblem: why a device cannot be driven, and what
// to do. OmniUsbNotFound: the same where none is plugged in.
const std::vector<UsbMatch::Ids>& OmniUsbIds();
std::string OmniUsbProblem(const UsbMatch::Ids& ids);
std::string OmniUsbNotFound();

class OmniUsbProtocol final : public UsbProtocol {
 public:
  // port: as in UsbMatch.
  explicit OmniUsbProtocol(const std::string& port = {});

  const DeviceDescription& spec() const override { return spec_; }
  const UsbMatch& match() const override { return match_; }

  // Always throws; kUnsuitable has the device's identity and what to do.
  std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) override;
  StreamReceived Receive(std::span<const std::uint8_t>, DeviceState&) noexcept override {
    return {};
  }
  std::size_t Encode(const DeviceCommand&,
                     std::span<std::uint8_t, kMaxFrameBytes>) noexcept override {
    return 0;
  }
  bool is_request_response() const override { return false; }
  void TearDown(UsbLink&) noexcept override {}
  const char* calibration_hint() const noexcept override { return "it cannot be driven"; }

 private:
  DeviceDescription spec_;
  UsbMatch match_;
};

}  // namespace palpate
