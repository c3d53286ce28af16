// The asynchronous transfers of a UsbLink: several IN transfers are always under way, and at most
// one OUT transfer.
//
// A stalled endpoint is cleared and the transfers continue. The stream ends at the third stall in a
// row without a good transfer in that direction.
//
// Threads: as UsbLink. Ownership: borrows the context and the handle. Transfers that End could not
// bring back belong to the kernel until the handle is closed: close the handle before this object
// is destroyed.
// Errors: BusError, thrown by Wait only.
#pragma once

#include <libusb.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/device/usb/usb_link.h"

namespace palpate {

// Owners for libusb's objects, a list of its devices by port name, and its errors as BusErrors.
// Private to this folder: code outside of it does not see libusb.
//
// Threads: as UsbLink.
struct LibusbDeleter {
  void operator()(libusb_context* context) const { libusb_exit(context); }
  void operator()(libusb_device* device) const { libusb_unref_device(device); }
  void operator()(libusb_device_handle* handle) const { libusb_close(handle); }
  void operator()(libusb_config_descriptor* c) const { libusb_free_config_descriptor(c); }
  void operator()(libusb_transfer* transfer) const { libusb_free_transfer(transfer); }
};
template <class T>
using LibusbPtr = std::unique_ptr<T, LibusbDeleter>;

// Throws kAbsent on a system without USB.
LibusbPtr<libusb_context> OpenLibusb();

struct PluggedDevice {
  LibusbPtr<libusb_device> device{};
  UsbFound found{};
};

// Returns the devices on all buses with one of the ids, in order of their ports.
std::vector<PluggedDevice> PluggedDevices(libusb_context* context,
                                          const std::vector<UsbMatch::Ids>& ids);

// Returns an error to throw. `what`: the failed action, for example "opening it".
BusError ErrorOf(int libusb_error, const std::string& what);

struct UsbEndpoint {
  std::uint8_t address = 0;
  std::uint8_t type = LIBUSB_TRANSFER_TYPE_BULK;  // or interrupt
  int packet_bytes = 64;
};

class UsbStream {
 public:
  // Enough for one frame per ms, even if this thread is late by 3 ms.
  static constexpr std::size_t kInTransfers = 4;
  static constexpr std::size_t kMaxOutBytes = 512;
  static constexpr int kMaxStalls = 3;
  // Other failures end the stream after this time without a good transfer in that direction.
  static constexpr std::chrono::milliseconds kErrorTime{50};
  // If a device takes no force for this long, it keeps an old one, so the stream ends.
  static constexpr std::chrono::milliseconds kOutTimeout{100};

  UsbStream(libusb_context* context, libusb_device_handle* handle, const UsbEndpoint& in,
            const UsbEndpoint& out, std::size_t in_bytes, UsbLink::Receiver receive,
            std::span<const std::uint8_t> safe_frame);
  UsbStream(const UsbStream&) = delete;
  UsbStream& operator=(const UsbStream&) = delete;

  void Start();
  // As in UsbLink.
  void Wait(std::chrono::microseconds longest);
  bool TrySend(std::span<const std::uint8_t> bytes);
  // Cancels all transfers and waits for a bounded time until they come back. Returns false if some
  // did not.
  bool End() noexcept;
  std::uint64_t transfer_errors() const { return transfer_errors_; }
  // How often a stalled endpoint was cleared.
  std::uint64_t mends() const { return mends_; }

 private:
  struct Transfer {
    LibusbPtr<libusb_transfer> transfer{};
    std::vector<std::uint8_t> buffer{};
    UsbStream* stream = nullptr;
    bool under_way = false;
  };
  struct Direction {
    UsbEndpoint endpoint{};
    bool stalled = false;
    int stalls = 0;  // in a row
    std::optional<std::chrono::steady_clock::time_point> failing_since{};
  };

  static void LIBUSB_CALL OnIn(libusb_transfer* transfer);
  static void LIBUSB_CALL OnOut(libusb_transfer* transfer);
  void Prepare(Transfer& transfer, const UsbEndpoint& endpoint, std::size_t bytes,
               libusb_transfer_cb_fn done, unsigned timeout_ms);
  void Submit(Transfer& transfer, Direction& direction);
  // Notes how a transfer ended. Returns true for a good transfer.
  bool Judge(libusb_transfer_status status, Direction& direction);
  void CountError(Direction& direction);
  void Mend(Direction& direction);
  void SendSafeFrame() noexcept;
  bool HasIdle() const;
  void SubmitIdle();
  void HandleEvents(std::chrono::microseconds longest);
  bool BringBack(std::span<Transfer> transfers) noexcept;
  void Fail(BusFault fault, const std::string& message);

  libusb_context* context_;
  libusb_device_handle* handle_;
  Direction in_;
  Direction out_;
  UsbLink::Receiver receive_;
  std::vector<std::uint8_t> safe_frame_;
  std::array<Transfer, kInTransfers> in_transfers_;
  Transfer out_transfer_;
  bool ending_ = false;
  std::optional<BusError> failure_;
  std::uint64_t transfer_errors_ = 0;
  std::uint64_t mends_ = 0;
};

}  // namespace palpate
