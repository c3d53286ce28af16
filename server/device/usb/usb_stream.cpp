#include "server/device/usb/usb_stream.h"

#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <new>
#include <string>
#include <utility>

namespace palpate {
namespace {

constexpr char kUsbFolder[] = "/dev/bus/usb";

// The kernel's name of the device in /sys/bus/usb/devices.
std::string PortOf(libusb_device* device) {
  std::array<std::uint8_t, 7> ports{};  // USB allows no deeper tree
  const int depth = libusb_get_port_numbers(device, ports.data(), static_cast<int>(ports.size()));
  std::string name = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < depth; ++i) {
    name += (i == 0 ? '-' : '.') + std::to_string(ports[static_cast<std::size_t>(i)]);
  }
  return name;
}

bool MayOpen(libusb_device* device) {
  std::array<char, 64> node{};
  std::snprintf(node.data(), node.size(), "%s/%03d/%03d", kUsbFolder, libusb_get_bus_number(device),
                libusb_get_device_address(device));
  return access(node.data(), R_OK | W_OK) == 0;
}

}  // namespace

LibusbPtr<libusb_context> OpenLibusb() {
  libusb_context* context = nullptr;
  const int error = libusb_init(&context);
  if (error == LIBUSB_SUCCESS) return LibusbPtr<libusb_context>(context);
  if (access(kUsbFolder, X_OK) != 0) {
    throw BusError(BusFault::kAbsent, std::string("not found: this system has no USB (no ") +
                                          kUsbFolder + "); in a container, pass it in");
  }
  throw ErrorOf(error, "starting libusb");
}

std::vector<PluggedDevice> PluggedDevices(libusb_context* context,
                                          const std::vector<UsbMatch::Ids>& ids) {
  libusb_device** list = nullptr;
  const ssize_t count = libusb_get_device_list(context, &list);
  if (count < 0) throw ErrorOf(static_cast<int>(count), "listing USB devices");
  std::vector<PluggedDevice> plugged;
  for (ssize_t i = 0; i < count; ++i) {
    LibusbPtr<libusb_device> device(list[i]);
    libusb_device_descriptor descriptor{};
    if (libusb_get_device_descriptor(device.get(), &descriptor) != LIBUSB_SUCCESS) continue;
    const UsbMatch::Ids its{.vendor = descriptor.idVendor, .product = descriptor.idProduct};
    if (std::find(ids.begin(), ids.end(), its) == ids.end()) continue;
    const UsbFound found{
        .ids = its, .port = PortOf(device.get()), .may_open = MayOpen(device.get())};
    plugged.push_back({.device = std::move(device), .found = found});
  }
  libusb_free_device_list(list, 0);
  std::sort(plugged.begin(), plugged.end(), [](const PluggedDevice& a, const PluggedDevice& b) {
    return a.found.port < b.found.port;
  });
  return plugged;
}

BusError ErrorOf(int libusb_error, const std::string& what) {
  const auto error = [&](BusFault fault, const std::string& reason) {
    return BusError(fault, what + ": " + reason);
  };
  switch (libusb_error) {
    case LIBUSB_ERROR_NO_DEVICE:
    case LIBUSB_ERROR_NOT_FOUND:
      return error(BusFault::kAbsent, "the device is gone: plug it in again");
    case LIBUSB_ERROR_ACCESS:
      return error(BusFault::kPermission, std::string(kPermissionHint));
    case LIBUSB_ERROR_BUSY:
      return error(
          BusFault::kBusy,
          "another program uses the device: end it (another palpated, the vendor's tools)");
    case LIBUSB_ERROR_PIPE:
      return error(BusFault::kStall, "the device refused");
    case LIBUSB_ERROR_TIMEOUT:
      return error(BusFault::kTimeout, "no answer in time");
    default:
      return error(BusFault::kBroken,
                   std::string(libusb_error_name(libusb_error)) +
                       ": unplug the device and plug it in again, into another port if it stays");
  }
}

std::vector<UsbFound> FindUsbDevices(const std::vector<UsbMatch::Ids>& ids) {
  std::vector<UsbFound> all;
  try {
    const LibusbPtr<libusb_context> context = OpenLibusb();
    for (const PluggedDevice& plugged : PluggedDevices(context.get(), ids)) {
      all.push_back(plugged.found);
    }
  } catch (const BusError& error) {
    if (error.fault() != BusFault::kAbsent) throw;
  }
  return all;
}

namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// The time for the kernel to give back cancelled transfers. It needs well under 1 ms.
constexpr milliseconds kBringBackTime{100};

// If a device sends more bytes than were asked for, the transfer fails. Whole packets always fit.
std::size_t WholePackets(std::size_t bytes, int packet_bytes) {
  const std::size_t packet = static_cast<std::size_t>(std::max(packet_bytes, 1));
  return (bytes + packet - 1) / packet * packet;
}

}  // namespace

UsbStream::UsbStream(libusb_context* context, libusb_device_handle* handle, const UsbEndpoint& in,
                     const UsbEndpoint& out, std::size_t in_bytes, UsbLink::Receiver receive,
                     std::span<const std::uint8_t> safe_frame)
    : context_(context),
      handle_(handle),
      in_{.endpoint = in},
      out_{.endpoint = out},
      receive_(std::move(receive)),
      safe_frame_(safe_frame.begin(), safe_frame.end()) {
  const std::size_t bytes = WholePackets(in_bytes, in.packet_bytes);
  for (Transfer& transfer : in_transfers_) Prepare(transfer, in, bytes, OnIn, 0);
  Prepare(out_transfer_, out, kMaxOutBytes, OnOut, static_cast<unsigned>(kOutTimeout.count()));
}

void UsbStream::Prepare(Transfer& transfer, const UsbEndpoint& endpoint, std::size_t bytes,
                        libusb_transfer_cb_fn done, unsigned timeout_ms) {
  transfer.transfer.reset(libusb_alloc_transfer(0));
  if (!transfer.transfer) throw std::bad_alloc();
  transfer.buffer.resize(bytes);
  transfer.stream = this;
  libusb_fill_bulk_transfer(transfer.transfer.get(), handle_, endpoint.address,
                            transfer.buffer.data(), static_cast<int>(bytes), done, &transfer,
                            timeout_ms);
  transfer.transfer->type = endpoint.type;
}

void UsbStream::Start() { SubmitIdle(); }

void UsbStream::Wait(microseconds longest) {
  // A failed transfer is tried again one Wait later, so that a failing bus does not make this loop
  // spin.
  const bool has_idle = HasIdle();
  if (!failure_) HandleEvents(longest);
  if (in_.stalled) Mend(in_);
  if (out_.stalled) Mend(out_);
  if (has_idle) SubmitIdle();
  if (failure_) throw BusError(*failure_);
}

bool UsbStream::TrySend(std::span<const std::uint8_t> bytes) {
  if (ending_ || failure_ || out_.stalled || out_transfer_.under_way) return false;
  if (bytes.size() > out_transfer_.buffer.size()) {
    Fail(BusFault::kBroken, "a frame of more than 512 bytes was to be sent");
    return false;
  }
  std::copy(bytes.begin(), bytes.end(), out_transfer_.buffer.begin());
  out_transfer_.transfer->length = static_cast<int>(bytes.size());
  Submit(out_transfer_, out_);
  return out_transfer_.under_way;
}

bool UsbStream::End() noexcept {
  SendSafeFrame();
  ending_ = true;
  const bool in_is_back = BringBack(in_transfers_);
  return BringBack({&out_transfer_, 1}) && in_is_back;
}

void UsbStream::OnIn(libusb_transfer* transfer) {
  Transfer& in = *static_cast<Transfer*>(transfer->user_data);
  UsbStream& stream = *in.stream;
  in.under_way = false;
  if (!stream.Judge(transfer->status, stream.in_) || stream.ending_) return;
  if (transfer->actual_length > 0) {
    stream.receive_({transfer->buffer, static_cast<std::size_t>(transfer->actual_length)});
  }
  // Wait clears a stalled endpoint first. No transfer may be under way then.
  if (!stream.failure_ && !stream.in_.stalled) stream.Submit(in, stream.in_);
}

void UsbStream::OnOut(libusb_transfer* transfer) {
  Transfer& out = *static_cast<Transfer*>(transfer->user_data);
  out.under_way = false;
  out.stream->Judge(transfer->status, out.stream->out_);
}

bool UsbStream::Judge(libusb_transfer_status status, Direction& direction) {
  switch (status) {
    case LIBUSB_TRANSFER_COMPLETED:
      direction.stalls = 0;
      direction.failing_since.reset();
      return true;
    case LIBUSB_TRANSFER_CANCELLED:
      return false;
    case LIBUSB_TRANSFER_NO_DEVICE:
      Fail(BusFault::kAbsent, "unplugged");
      return false;
    case LIBUSB_TRANSFER_STALL:
      ++transfer_errors_;
      direction.stalled = true;
      return false;
    case LIBUSB_TRANSFER_TIMED_OUT:
      ++transfer_errors_;
      Fail(BusFault::kTimeout, "no force taken for " + std::to_string(kOutTimeout.count()) + " ms");
      return false;
    default:
      CountError(direction);
      return false;
  }
}

void UsbStream::CountError(Direction& direction) {
  ++transfer_errors_;
  const steady_clock::time_point now = steady_clock::now();
  if (!direction.failing_since) direction.failing_since = now;
  if (now - *direction.failing_since > kErrorTime) {
    Fail(BusFault::kBroken, "transfers fail: check the cable and the port");
  }
}

void UsbStream::Submit(Transfer& transfer, Direction& direction) {
  const int error = libusb_submit_transfer(transfer.transfer.get());
  transfer.under_way = error == LIBUSB_SUCCESS;
  if (error == LIBUSB_SUCCESS) return;
  if (error == LIBUSB_ERROR_NO_DEVICE) {
    Fail(BusFault::kAbsent, "unplugged");
  } else if (error == LIBUSB_ERROR_PIPE) {
    ++transfer_errors_;
    direction.stalled = true;
  } else {
    failure_ = ErrorOf(error, "starting a transfer");
  }
}

void UsbStream::Mend(Direction& direction) {
  if (failure_) return;
  if (++direction.stalls >= kMaxStalls) {
    Fail(BusFault::kStall, "endpoint stalled " + std::to_string(kMaxStalls) + " times");
    return;
  }
  ++mends_;
  if (&direction == &in_) SendSafeFrame();
  if (&direction == &in_ && !BringBack(in_transfers_)) {
    Fail(BusFault::kBroken, "transfers do not end");
    return;
  }
  direction.stalled = false;
  const int error = libusb_clear_halt(handle_, direction.endpoint.address);
  if (error != LIBUSB_SUCCESS) {
    failure_ = ErrorOf(error, "clearing a stalled endpoint");
    return;
  }
  SubmitIdle();
}

// Attempted after any failure. The frame goes out while other transfers are brought back.
void UsbStream::SendSafeFrame() noexcept {
  if (safe_frame_.empty() || out_.stalled || out_transfer_.under_way) return;
  std::copy(safe_frame_.begin(), safe_frame_.end(), out_transfer_.buffer.begin());
  out_transfer_.transfer->length = static_cast<int>(safe_frame_.size());
  out_transfer_.under_way = libusb_submit_transfer(out_transfer_.transfer.get()) == LIBUSB_SUCCESS;
}

bool UsbStream::HasIdle() const {
  return std::any_of(in_transfers_.begin(), in_transfers_.end(),
                     [](const Transfer& transfer) { return !transfer.under_way; });
}

void UsbStream::SubmitIdle() {
  for (Transfer& transfer : in_transfers_) {
    if (!failure_ && !in_.stalled && !transfer.under_way) Submit(transfer, in_);
  }
}

void UsbStream::HandleEvents(microseconds longest) {
  timeval time{};
  time.tv_sec = static_cast<time_t>(longest.count() / 1'000'000);
  time.tv_usec = static_cast<suseconds_t>(longest.count() % 1'000'000);
  const int error = libusb_handle_events_timeout_completed(context_, &time, nullptr);
  if (error != LIBUSB_SUCCESS && error != LIBUSB_ERROR_INTERRUPTED && !failure_) {
    failure_ = ErrorOf(error, "waiting for transfers");
  }
}

bool UsbStream::BringBack(std::span<Transfer> transfers) noexcept {
  const auto is_back = [&] {
    return std::none_of(transfers.begin(), transfers.end(),
                        [](const Transfer& transfer) { return transfer.under_way; });
  };
  const bool was_ending = std::exchange(ending_, true);  // no transfer is submitted again
  for (Transfer& transfer : transfers) {
    if (transfer.under_way) libusb_cancel_transfer(transfer.transfer.get());
  }
  const steady_clock::time_point deadline = steady_clock::now() + kBringBackTime;
  while (!is_back() && steady_clock::now() < deadline) HandleEvents(milliseconds(5));
  ending_ = was_ending;
  return is_back();
}

void UsbStream::Fail(BusFault fault, const std::string& message) {
  if (!failure_) failure_.emplace(fault, message);
}

}  // namespace palpate
