// One opened USB device: its claimed interfaces, its two data endpoints, and the transfer of bytes.
//
// Threads: only the I/O thread that opened it, so libusb's locks stay on that thread.
// Real-time: none. The stream's transfers are allocated before the stream starts.
// Ownership: the destructor cancels transfers under way, closes the device, and attaches the
// kernel's driver again.
// Errors: BusError.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/device/stream/bus_error.h"

namespace palpate {

// Selects a device and its data interface.
struct UsbMatch {
  struct Ids {
    std::uint16_t vendor = 0;
    std::uint16_t product = 0;
    bool operator==(const Ids&) const = default;
  };
  std::vector<Ids> ids{};
  std::string port{};  // "1-2.3", as in /sys/bus/usb/devices; "": the only device
  // The class (bInterfaceClass) of the interface with the data endpoints, for example
  // LIBUSB_CLASS_DATA. All interfaces of the device are claimed.
  std::uint8_t data_class = 0;
  // Says why a device with these ids cannot be driven ("": it can). Null: all can be driven.
  std::string (*problem_of)(const Ids&) = nullptr;
};

// A device that is plugged in.
struct UsbFound {
  UsbMatch::Ids ids{};
  std::string port{};
  bool may_open = false;  // this user may open it
};

// Returns the devices on all buses with one of the ids. Opens none.
std::vector<UsbFound> FindUsbDevices(const std::vector<UsbMatch::Ids>& ids);

class UsbLink {
 public:
  // Finds, opens and claims the device.
  explicit UsbLink(const UsbMatch& match);
  ~UsbLink();
  UsbLink(const UsbLink&) = delete;
  UsbLink& operator=(const UsbLink&) = delete;

  const UsbFound& found() const;

  // Control, Send and Receive: one at a time, and only before and after the stream. Control's
  // parameters are those of USB's set-up packets. The direction bit of request_type says whether
  // data is sent or filled. Returns the number of bytes transferred.
  std::size_t Control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                      std::uint16_t index, std::span<std::uint8_t> data,
                      std::chrono::milliseconds timeout);
  void Send(std::span<const std::uint8_t> bytes, std::chrono::milliseconds timeout);
  std::size_t Receive(std::span<std::uint8_t> bytes, std::chrono::milliseconds timeout);

  // From now on IN transfers are always under way. Wait passes their bytes to `receive`, on this
  // thread. `safe_frame` (may be empty) is sent before an action that may take long: clearing a
  // stalled endpoint, ending the stream.
  using Receiver = std::function<void(std::span<const std::uint8_t>)>;
  void StartStream(std::size_t transfer_bytes, Receiver receive,
                   std::span<const std::uint8_t> safe_frame);
  // Handles what is due, for at most this long. Throws the error that ended the stream: stalls that
  // clearing does not repair, a missing device.
  void Wait(std::chrono::microseconds longest);
  // Queues an OUT transfer of at most 512 bytes. Returns false if the last OUT transfer is still
  // under way; the caller then tries again with newer bytes. May also be called within `receive`.
  bool TrySend(std::span<const std::uint8_t> bytes);
  // Ends the stream. Send and Receive work again if the device is still there.
  void EndStream() noexcept;
  // The number of transfers that failed and were tried again.
  std::uint64_t transfer_errors() const;
  // How often the present stream has sent the safe frame and gone on.
  std::uint64_t mends() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
