// One opened USB device: its claimed interfaces, its two data endpoints, and bytes.
//
// Threads: the I/O thread that opened it only; libusb's locks stay on that thread.
// Real-time: none; transfers of the stream are allocated before it starts.
// Ownership: closes what it opened, cancels what is in flight, and gives the kernel's
// driver back, whatever way it ends.
// Errors: UsbError.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

enum class UsbFault : std::uint8_t {
  kAbsent,      // not found, or gone
  kPermission,  // found, but this user may not open it
  kBusy,        // somebody else has claimed it
  kAmbiguous,   // several match and none was named
  kUnsuitable,  // it has not the interfaces or endpoints that it should have
  kStall,       // an endpoint refused
  kTimeout,     // no answer in time
  kCorrupt,     // an answer that is none
  kBroken,      // any other failure of the bus
};

// what() is one line: what is wrong and what to do.
class UsbError : public std::runtime_error {
 public:
  UsbError(UsbFault fault, const std::string& message)
      : std::runtime_error(message), fault_(fault) {}
  UsbFault fault() const { return fault_; }

 private:
  UsbFault fault_;
};

// Which device is meant, and which of its parts.
struct UsbMatch {
  struct Ids {
    std::uint16_t vendor = 0;
    std::uint16_t product = 0;
    bool operator==(const Ids&) const = default;
  };
  std::vector<Ids> ids{};
  std::string port{};  // "1-2.3", as in /sys/bus/usb/devices; "": the only one there is
  // The interface with the data endpoints, by class (bInterfaceClass), such as
  // LIBUSB_CLASS_DATA; all interfaces of the device are claimed.
  std::uint8_t data_class = 0;
  // Why one with these ids cannot be driven ("": it can); null: all can.
  std::string (*problem_of)(const Ids&) = nullptr;
};

// What is plugged in.
struct UsbFound {
  UsbMatch::Ids ids{};
  std::string port{};
  bool may_open = false;  // by this user
};

// What to do about kPermission.
inline constexpr std::string_view kUsbPermissionHint =
    "this user may not open the device: install deploy/udev/70-palpate.rules, then unplug it and "
    "plug it in again";

// Of all devices on the buses; those whose ids match. Opens none.
std::vector<UsbFound> FindUsbDevices(const std::vector<UsbMatch::Ids>& ids);

class UsbLink {
 public:
  // Finds, opens and claims the device.
  explicit UsbLink(const UsbMatch& match);
  ~UsbLink();
  UsbLink(const UsbLink&) = delete;
  UsbLink& operator=(const UsbLink&) = delete;

  const UsbFound& found() const;

  // One at a time, before and after the stream. request_type etc. as in USB's set-up
  // packets; data goes out or is filled according to the direction bit of
  // request_type. Returns the bytes that went.
  std::size_t Control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                      std::uint16_t index, std::span<std::uint8_t> data,
                      std::chrono::milliseconds timeout);
  void Send(std::span<const std::uint8_t> bytes, std::chrono::milliseconds timeout);
  std::size_t Receive(std::span<std::uint8_t> bytes, std::chrono::milliseconds timeout);

  // From here on IN transfers are always under way. What they bring goes to `receive`,
  // on this thread, during Wait. `safe_frame` (may be empty) is sent before anything
  // that may take long: mending a stalled endpoint, ending the stream.
  using Receiver = std::function<void(std::span<const std::uint8_t>)>;
  void StartStream(std::size_t transfer_bytes, Receiver receive,
                   std::span<const std::uint8_t> safe_frame);
  // Handles what is due, for at most that long. Throws what ended the stream: stalls
  // that clearing does not mend, the device's absence.
  void Wait(std::chrono::microseconds longest);
  // Queues an OUT transfer unless the last one is still under way: false then, and
  // the caller tries again with newer bytes. `bytes`: at most 512. Within `receive`,
  // too.
  bool TrySend(std::span<const std::uint8_t> bytes);
  // Ends the stream; Send and Receive work again where the device is still there.
  void EndStream() noexcept;
  // Transfers that failed and were tried again.
  std::uint64_t transfer_errors() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
