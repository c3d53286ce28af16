// The Phantom Omni / Geomagic Touch on USB: says who it is, and that it cannot be driven.
//
// The framing of the serial line and the identity queries come from one published trace
// (usb_frames.h). The servo frames over USB are not public: nothing is decoded, and nothing is sent
// after the queries.
//
// Verification level of all of it: none. We have not seen a device.
//
// Threads, real-time: as UsbProtocol. Errors: BusError from SetUp.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "server/device/usb/usb_protocol.h"

namespace palpate {

// What we have seen of this device on hardware. Raise it one step at a time, with the evidence that
// deploy/guides/devices.md asks for.
inline constexpr VerificationLevel kOmniUsbVerification = VerificationLevel::kNone;

// The spec of the device, also without a device.
DeviceDescription OmniUsbSpec();

// OmniUsbIds: the ids of all known devices. OmniUsbProblem: why a device is not even asked who it
// is ("": it is).
const std::vector<UsbMatch::Ids>& OmniUsbIds();
std::string OmniUsbProblem(const UsbMatch::Ids& ids);

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
