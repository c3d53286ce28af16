// An emulated USB device: its descriptors, its behaviour (control requests, data from and to the
// host), its faults, and a log of the host's actions. UsbTestbed plugs it into a bus;
// SetDirectUsb does without one.
//
// It proves behaviour, not timing, and nothing about hardware: it is only as true as our knowledge
// of a device.
//
// Threads: tests on any thread. The testbed's threads call the model's own functions (On...), one
// at a time, with mutex() held.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/emulated.h"

namespace palpate {
class UsbLink;
}

namespace palpate::test {

struct UsbEndpointSpec {
  std::uint8_t address = 0;  // bit 7: towards the host
  std::uint8_t type = 2;     // 2: bulk, 3: interrupt
  std::uint16_t packet_bytes = 64;
  std::uint8_t interval = 0;
};

struct UsbInterfaceSpec {
  std::uint8_t device_class = 0xff;
  std::uint8_t subclass = 0;
  std::uint8_t protocol = 0;
  std::vector<UsbEndpointSpec> endpoints{};
  std::string kernel_driver{};  // bound when plugged in; "": none
};

struct UsbSpec {
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::uint8_t device_class = 0;
  std::vector<UsbInterfaceSpec> interfaces{};
};

// The descriptors of the device and of its one configuration, as in sysfs.
Bytes MakeUsbDescriptors(const UsbSpec& spec);

// The first eight bytes of a control transfer.
struct UsbSetup {
  std::uint8_t request_type = 0;
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
  std::uint16_t length = 0;
};

struct UsbFaults {
  bool silent = false;                      // nothing comes from the device
  bool deaf = false;                        // OUT transfers never end
  bool busy = false;                        // another program has claimed the interfaces
  std::optional<std::size_t> cut_in_to{};   // IN transfers end after this many bytes
  std::optional<std::size_t> corrupt_in{};  // this byte of each IN transfer is wrong
  bool refuses_requests = false;            // stalls all control requests
  std::optional<int> outs_until_gone{};     // then pulled out; without a bus only
};

// The host's actions, in order.
struct UsbEvent {
  enum class Kind : std::uint8_t {
    kOpen,
    kClose,
    kClaim,    // number: interface
    kRelease,  // number: interface
    kDetachDriver,
    kAttachDriver,
    kControl,  // set-up bytes, then data to the device
    kOut,      // number: endpoint
    kLateOut,  // as kOut, but tried after the device was pulled out
    kClearHalt,
  };
  Kind kind = Kind::kOpen;
  std::uint8_t number = 0;
  Bytes bytes{};
};

class EmulatedUsbDevice {
 public:
  explicit EmulatedUsbDevice(UsbSpec spec) : spec_(std::move(spec)) {}
  virtual ~EmulatedUsbDevice() = default;
  EmulatedUsbDevice(const EmulatedUsbDevice&) = delete;
  EmulatedUsbDevice& operator=(const EmulatedUsbDevice&) = delete;

  const UsbSpec& spec() const { return spec_; }

  void SetFaults(const UsbFaults& faults) {
    const std::scoped_lock lock(mutex_);
    faults_ = faults;
  }
  // Refuses transfers of an endpoint, until the host clears the halt, or for ever.
  void Stall(std::uint8_t endpoint, bool for_ever) {
    const std::scoped_lock lock(mutex_);
    stalls_[endpoint] = for_ever;
  }
  void EndStalls() {
    const std::scoped_lock lock(mutex_);
    stalls_.clear();
  }

  std::vector<UsbEvent> Events() const {
    const std::scoped_lock lock(mutex_);
    return events_;
  }
  std::size_t CountOf(UsbEvent::Kind kind) const {
    return static_cast<std::size_t>(std::ranges::count(Events(), kind, &UsbEvent::kind));
  }
  // The number of IN transfers with data. If the emulated bus is slower than the device, it loses
  // further data of the device.
  std::uint64_t InTransfers() const {
    const std::scoped_lock lock(mutex_);
    return in_transfers_;
  }

 protected:
  std::mutex& mutex() const { return mutex_; }

  virtual void OnPlugged() {}
  // Returns the bytes of the answer, or the number of accepted bytes; none: refused (a stall).
  virtual std::optional<std::size_t> OnControl(const UsbSetup& setup,
                                               std::span<std::uint8_t> data) = 0;
  virtual void OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) = 0;
  // Called every millisecond while plugged in.
  virtual void OnMillisecond() = 0;

  // Queues the bytes of one IN transfer. The device's memory is small: if no host reads, the oldest
  // are lost.
  void QueueIn(std::uint8_t endpoint, Bytes bytes);
  bool IsInEmpty(std::uint8_t endpoint) const;
  void EndFaults() { faults_ = {}; }

 private:
  // These hold the mutex. A UsbLink without a bus has the device for itself.
  friend class UsbPort;
  friend class palpate::UsbLink;

  // As the device and its faults have it. None: refused (a stall).
  std::optional<std::size_t> Control(const UsbSetup& setup, std::span<std::uint8_t> data);
  // Returns false if it does not end.
  bool Out(std::uint8_t endpoint, std::span<const std::uint8_t> bytes);
  // None: nothing comes.
  std::optional<Bytes> TakeIn(std::uint8_t endpoint);
  void Log(UsbEvent::Kind kind, std::uint8_t number = 0, std::span<const std::uint8_t> bytes = {});
  bool IsStalled(std::uint8_t endpoint) const { return stalls_.contains(endpoint); }

  const UsbSpec spec_;
  mutable std::mutex mutex_;
  UsbFaults faults_;
  std::map<std::uint8_t, bool> stalls_;  // by endpoint; true: for ever
  std::map<std::uint8_t, std::deque<Bytes>> in_;
  std::vector<UsbEvent> events_;
  std::uint64_t in_transfers_ = 0;
};

// UsbLink without USB, for a test that links direct_usb_link.cpp instead of palpate::usb: all links
// made from now on lead straight to this device, on port 1-2. Its milliseconds pass when a link
// receives. For one thread, and not for streams: their functions do nothing.
void SetDirectUsb(EmulatedUsbDevice& device);

}  // namespace palpate::test
