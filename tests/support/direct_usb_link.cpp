// UsbLink without USB: see SetDirectUsb.
#include "server/device/usb/usb_link.h"

#include <algorithm>
#include <thread>

#include "tests/support/usb_emulator.h"

namespace palpate {
namespace {

test::EmulatedUsbDevice* current = nullptr;

std::uint8_t BulkEndpoint(const test::UsbSpec& spec, bool in) {
  for (const test::UsbInterfaceSpec& part : spec.interfaces) {
    for (const test::UsbEndpointSpec& endpoint : part.endpoints) {
      if (endpoint.type == 2 && (endpoint.address >= 0x80) == in) return endpoint.address;
    }
  }
  return 0;
}

}  // namespace

void test::SetDirectUsb(EmulatedUsbDevice& device) { current = &device; }

struct UsbLink::Impl {
  test::EmulatedUsbDevice& device;
  UsbFound found;
};

UsbLink::UsbLink(const UsbMatch&)
    : impl_(new Impl{*current,
                     {.ids = {current->spec().vendor, current->spec().product},
                      .port = "1-2",
                      .may_open = true}}) {}
UsbLink::~UsbLink() = default;

const UsbFound& UsbLink::found() const { return impl_->found; }

std::size_t UsbLink::Control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                             std::uint16_t index, std::span<std::uint8_t> data,
                             std::chrono::milliseconds) {
  const auto length = static_cast<std::uint16_t>(data.size());
  const auto answered = impl_->device.Control({request_type, request, value, index, length}, data);
  if (!answered) throw BusError(BusFault::kStall, "stalled");
  return std::min(*answered, data.size());
}

void UsbLink::Send(std::span<const std::uint8_t> bytes, std::chrono::milliseconds) {
  test::EmulatedUsbDevice& device = impl_->device;
  const std::uint8_t endpoint = BulkEndpoint(device.spec(), false);
  std::optional<int>& left = device.faults_.outs_until_gone;
  if (left && (*left)-- <= 0) {
    device.Log(test::UsbEvent::Kind::kLateOut, endpoint, bytes);
    throw BusError(BusFault::kAbsent, "gone");
  }
  if (!device.Out(endpoint, bytes)) throw BusError(BusFault::kTimeout, "not taken");
}

std::size_t UsbLink::Receive(std::span<std::uint8_t> bytes, std::chrono::milliseconds timeout) {
  const std::uint8_t endpoint = BulkEndpoint(impl_->device.spec(), true);
  for (std::int64_t n = 0; n <= timeout.count(); ++n) {
    impl_->device.OnMillisecond();
    if (const auto packet = impl_->device.TakeIn(endpoint)) {
      std::copy_n(packet->begin(), std::min(packet->size(), bytes.size()), bytes.begin());
      return std::min(packet->size(), bytes.size());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  throw BusError(BusFault::kTimeout, "no answer");
}

void UsbLink::StartStream(std::size_t, Receiver, std::span<const std::uint8_t>) {}
void UsbLink::Wait(std::chrono::microseconds) {}
bool UsbLink::TrySend(std::span<const std::uint8_t>) { return true; }
void UsbLink::EndStream() noexcept {}
std::uint64_t UsbLink::transfer_errors() const { return 0; }

}  // namespace palpate
