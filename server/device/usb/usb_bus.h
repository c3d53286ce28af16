// A kind of device on USB, for StreamedDevice: finds it, and streams what its protocol says.
//
// Threads, errors: as StreamBus.
#pragma once

#include <memory>
#include <string>

#include "server/device/stream/streamed_device.h"
#include "server/device/usb/usb_protocol.h"

namespace palpate {

class UsbBus final : public StreamBus {
 public:
  explicit UsbBus(std::unique_ptr<UsbProtocol> protocol) : protocol_(std::move(protocol)) {}

  const DeviceDescription& spec() const override { return protocol_->spec(); }
  std::unique_ptr<StreamSession> Open(const std::atomic<bool>& stop) override;
  bool is_request_response() const override { return protocol_->is_request_response(); }
  std::string calibration_hint() const override { return protocol_->calibration_hint(); }
  void RequestCalibration() override {
    if (!protocol_->RequestCalibration()) StreamBus::RequestCalibration();
  }

 private:
  const std::unique_ptr<UsbProtocol> protocol_;
};

}  // namespace palpate
