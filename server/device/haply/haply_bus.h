// Haply's Inverse3, Inverse3x and Minverse by the vendor's service on this machine.
//
// The service answers each message with one state of the devices, and sends nothing unasked. So the
// I/O thread asks at most 2000 times a second, and never again before the answer: but for a zero
// force when the answer is late. With motors on each message commands a force, else none.
// A session ends with its connection, and its force with it. How long the service keeps the last
// force of a palpated that is frozen, its documents do not say.
//
// Others may change what a session has set. If a mount, basis, scale or damping is not ours, what
// is shown is not what is felt: the device then counts as not calibrated, and gets no force. So it
// does if there is a global factor on forces, which is looked at when palpated connects. The
// service weakens forces by filters of its own. Not noticed: a service that answers with the same
// state for ever.
//
// Frame M: its middle is that of the workspace.
// Threads, errors: as StreamBus. The service is talked to on the I/O thread.
// Verification level: none; we have not seen a device, and not run the vendor's service.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "server/device/haply/inverse_link.h"
#include "server/device/stream/streamed_device.h"

namespace palpate {

inline constexpr VerificationLevel kHaplyVerification = VerificationLevel::kNone;

struct HaplyOptions {
  std::string model = "inverse3";  // or "inverse3x" or "minverse"
  std::string serial{};            // the arm's device_id; "": the only one
  std::string grip{};              // the handle's device_id; "": the only one, or none
  std::uint16_t port = 10001;
  std::uint16_t events_port = 10020;
};

// Throws Error (kInvalidArgument) for a model that is none.
DeviceDescription HaplySpec(const std::string& model);

// The arms of a running service. Throws BusError if there is none. Any thread.
std::vector<InverseArm> FindInverseArms(std::uint16_t port);

class HaplyBus final : public StreamBus {
 public:
  static constexpr int kRateHz = 2000;

  explicit HaplyBus(HaplyOptions options);

  const DeviceDescription& spec() const override { return spec_; }
  std::unique_ptr<StreamSession> Open(const std::atomic<bool>& stop) override;
  std::string calibration_hint() const override { return hint_.load(); }

 private:
  const HaplyOptions options_;
  const DeviceDescription spec_;
  std::atomic<const char*> hint_{""};
};

}  // namespace palpate
