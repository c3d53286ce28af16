#include "server/device/usb/usb_link.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "server/device/usb/usb_stream.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;

const char* const kSeeList = "plug it in, or see `palpate device list`";

LibusbPtr<libusb_device> Choose(libusb_context* context, const UsbMatch& match, UsbFound& found) {
  std::vector<PluggedDevice> plugged = PluggedDevices(context, match.ids);
  if (!match.port.empty()) {
    std::erase_if(plugged, [&](const PluggedDevice& it) { return it.found.port != match.port; });
  }
  if (plugged.empty()) {
    const std::string where = match.port.empty() ? "" : " on USB port " + match.port;
    throw BusError(BusFault::kAbsent, "not found" + where + ": " + kSeeList);
  }
  if (plugged.size() > 1) {
    std::string ports;
    for (const PluggedDevice& it : plugged) {
      ports += (ports.empty() ? "" : ", ") + it.found.port;
    }
    throw BusError(BusFault::kAmbiguous, "several are plugged in, on USB ports " + ports +
                                             ": set [device] usb_port to one of them");
  }
  found = plugged.front().found;
  return std::move(plugged.front().device);
}

// libusb takes 0 as no limit.
unsigned TimeoutMs(milliseconds timeout) {
  return static_cast<unsigned>(std::max<milliseconds::rep>(timeout.count(), 1));
}

bool IsData(const libusb_endpoint_descriptor& endpoint) {
  const int type = endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK;
  return type == LIBUSB_TRANSFER_TYPE_BULK || type == LIBUSB_TRANSFER_TYPE_INTERRUPT;
}

UsbEndpoint EndpointOf(const libusb_endpoint_descriptor& descriptor) {
  return {.address = descriptor.bEndpointAddress,
          .type = static_cast<std::uint8_t>(descriptor.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK),
          .packet_bytes = descriptor.wMaxPacketSize & 0x7ff};
}

}  // namespace

struct UsbLink::Impl {
  explicit Impl(const UsbMatch& match);
  ~Impl();
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void Open(libusb_device* device);
  void Claim(const libusb_config_descriptor& configuration);
  void ClaimInterface(int number);
  void Release() noexcept;
  void FindEndpoints(const libusb_config_descriptor& configuration, std::uint8_t data_class);
  // Returns the number of bytes transferred through the data endpoint.
  std::size_t Transfer(const UsbEndpoint& endpoint, std::uint8_t* data, std::size_t size,
                       milliseconds timeout, const char* what);
  UsbStream& Stream();

  // Declared in this order because the stream's transfers belong to the kernel until the handle is
  // closed.
  LibusbPtr<libusb_context> context;
  std::unique_ptr<UsbStream> stream;
  LibusbPtr<libusb_device_handle> handle;
  UsbFound found;
  std::vector<int> claimed;   // interfaces
  std::vector<int> detached;  // interfaces whose kernel drivers are to be attached again
  UsbEndpoint in;
  UsbEndpoint out;
  std::uint64_t earlier_errors = 0;  // of earlier streams
};

UsbLink::Impl::Impl(const UsbMatch& match) : context(OpenLibusb()) {
  const LibusbPtr<libusb_device> device = Choose(context.get(), match, found);
  const std::string problem = match.problem_of ? match.problem_of(found.ids) : std::string();
  if (!problem.empty()) {
    throw BusError(BusFault::kUnsuitable, "found on USB port " + found.port + ", but " + problem);
  }
  Open(device.get());
  libusb_config_descriptor* active = nullptr;
  if (libusb_get_active_config_descriptor(device.get(), &active) != LIBUSB_SUCCESS) {
    throw BusError(BusFault::kUnsuitable, "found on USB port " + found.port +
                                              ", but it is not configured: unplug it and plug it "
                                              "in again");
  }
  const LibusbPtr<libusb_config_descriptor> configuration(active);
  FindEndpoints(*configuration, match.data_class);
  try {
    Claim(*configuration);
  } catch (...) {
    Release();
    throw;
  }
}

UsbLink::Impl::~Impl() {
  if (stream) stream->End();
  Release();
}

void UsbLink::Impl::Open(libusb_device* device) {
  libusb_device_handle* opened = nullptr;
  const int error = libusb_open(device, &opened);
  if (error != LIBUSB_SUCCESS) throw ErrorOf(error, "found on USB port " + found.port);
  handle.reset(opened);
}

void UsbLink::Impl::Claim(const libusb_config_descriptor& configuration) {
  for (int i = 0; i < configuration.bNumInterfaces; ++i) {
    const libusb_interface& interface = configuration.interface[i];
    if (interface.num_altsetting > 0) ClaimInterface(interface.altsetting[0].bInterfaceNumber);
  }
}

void UsbLink::Impl::ClaimInterface(int number) {
  const std::string what =
      "claiming interface " + std::to_string(number) + " on USB port " + found.port;
  if (libusb_kernel_driver_active(handle.get(), number) == 1) {
    const int error = libusb_detach_kernel_driver(handle.get(), number);
    // A driver of two interfaces leaves both at once.
    if (error != LIBUSB_SUCCESS && error != LIBUSB_ERROR_NOT_FOUND) throw ErrorOf(error, what);
    detached.push_back(number);
  }
  const int error = libusb_claim_interface(handle.get(), number);
  if (error != LIBUSB_SUCCESS) throw ErrorOf(error, what);
  claimed.push_back(number);
}

// Releases all interfaces before it attaches the first driver: a driver of two interfaces (CDC-ACM)
// needs both to be free.
void UsbLink::Impl::Release() noexcept {
  for (const int number : claimed) libusb_release_interface(handle.get(), number);
  for (const int number : detached) libusb_attach_kernel_driver(handle.get(), number);
  claimed.clear();
  detached.clear();
}

void UsbLink::Impl::FindEndpoints(const libusb_config_descriptor& configuration,
                                  std::uint8_t data_class) {
  for (int i = 0; i < configuration.bNumInterfaces; ++i) {
    const libusb_interface& interface = configuration.interface[i];
    if (interface.num_altsetting == 0) continue;
    const libusb_interface_descriptor& setting = interface.altsetting[0];
    if (setting.bInterfaceClass != data_class) continue;
    std::optional<UsbEndpoint> first_in;
    std::optional<UsbEndpoint> first_out;
    for (int k = 0; k < setting.bNumEndpoints; ++k) {
      const libusb_endpoint_descriptor& endpoint = setting.endpoint[k];
      if (!IsData(endpoint)) continue;
      const bool is_in = (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0;
      std::optional<UsbEndpoint>& first = is_in ? first_in : first_out;
      if (!first) first = EndpointOf(endpoint);
    }
    if (first_in && first_out) {
      in = *first_in;
      out = *first_out;
      return;
    }
  }
  throw BusError(BusFault::kUnsuitable,
                 "found on USB port " + found.port + ", but it has no interface of class " +
                     std::to_string(data_class) +
                     " with a data endpoint each way: another device, or another mode of it");
}

std::size_t UsbLink::Impl::Transfer(const UsbEndpoint& endpoint, std::uint8_t* data,
                                    std::size_t size, milliseconds timeout, const char* what) {
  const auto transfer = endpoint.type == LIBUSB_TRANSFER_TYPE_INTERRUPT ? libusb_interrupt_transfer
                                                                        : libusb_bulk_transfer;
  int went = 0;
  const int error = transfer(handle.get(), endpoint.address, data, static_cast<int>(size), &went,
                             TimeoutMs(timeout));
  if (error == LIBUSB_ERROR_PIPE) libusb_clear_halt(handle.get(), endpoint.address);
  // A timeout after some bytes is no error: the bytes have arrived.
  if (error != LIBUSB_SUCCESS && (error != LIBUSB_ERROR_TIMEOUT || went == 0)) {
    throw ErrorOf(error, what);
  }
  return static_cast<std::size_t>(went);
}

UsbStream& UsbLink::Impl::Stream() {
  if (!stream) throw BusError(BusFault::kBroken, "there is no stream: start it first");
  return *stream;
}

UsbLink::UsbLink(const UsbMatch& match) : impl_(std::make_unique<Impl>(match)) {}

UsbLink::~UsbLink() = default;

const UsbFound& UsbLink::found() const { return impl_->found; }

std::size_t UsbLink::Control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                             std::uint16_t index, std::span<std::uint8_t> data,
                             milliseconds timeout) {
  const int went =
      libusb_control_transfer(impl_->handle.get(), request_type, request, value, index, data.data(),
                              static_cast<std::uint16_t>(data.size()), TimeoutMs(timeout));
  if (went < 0) throw ErrorOf(went, "a control request to the device");
  return static_cast<std::size_t>(went);
}

void UsbLink::Send(std::span<const std::uint8_t> bytes, milliseconds timeout) {
  // libusb does not change the bytes that it sends.
  const std::size_t went = impl_->Transfer(impl_->out, const_cast<std::uint8_t*>(bytes.data()),
                                           bytes.size(), timeout, "sending to the device");
  if (went < bytes.size()) throw ErrorOf(LIBUSB_ERROR_TIMEOUT, "sending to the device");
}

std::size_t UsbLink::Receive(std::span<std::uint8_t> bytes, milliseconds timeout) {
  return impl_->Transfer(impl_->in, bytes.data(), bytes.size(), timeout,
                         "receiving from the device");
}

void UsbLink::StartStream(std::size_t transfer_bytes, Receiver receive,
                          std::span<const std::uint8_t> safe_frame) {
  if (impl_->stream) throw BusError(BusFault::kBroken, "there is a stream: end it first");
  impl_->stream =
      std::make_unique<UsbStream>(impl_->context.get(), impl_->handle.get(), impl_->in, impl_->out,
                                  transfer_bytes, std::move(receive), safe_frame);
  impl_->stream->Start();
}

void UsbLink::Wait(std::chrono::microseconds longest) { impl_->Stream().Wait(longest); }

bool UsbLink::TrySend(std::span<const std::uint8_t> bytes) {
  return impl_->Stream().TrySend(bytes);
}

void UsbLink::EndStream() noexcept {
  if (!impl_->stream || !impl_->stream->End()) return;
  impl_->earlier_errors += impl_->stream->transfer_errors();
  impl_->stream.reset();
}

std::uint64_t UsbLink::mends() const { return impl_->stream ? impl_->stream->mends() : 0; }

std::uint64_t UsbLink::transfer_errors() const {
  return impl_->earlier_errors + (impl_->stream ? impl_->stream->transfer_errors() : 0);
}

}  // namespace palpate
