#include "tests/support/usb_emulator.h"

#include <algorithm>

namespace palpate::test {
namespace {

constexpr std::size_t kInQueueTransfers = 8;

void PutWord(unsigned word, Bytes& bytes) {
  bytes.push_back(static_cast<std::uint8_t>(word));
  bytes.push_back(static_cast<std::uint8_t>(word >> 8));
}

void PutInterface(const UsbInterfaceSpec& part, std::size_t number, Bytes& bytes) {
  bytes.insert(bytes.end(), {9, 4, static_cast<std::uint8_t>(number), 0,
                             static_cast<std::uint8_t>(part.endpoints.size()), part.device_class,
                             part.subclass, part.protocol, 0});
  for (const UsbEndpointSpec& endpoint : part.endpoints) {
    bytes.insert(bytes.end(), {7, 5, endpoint.address, endpoint.type});
    PutWord(endpoint.packet_bytes, bytes);
    bytes.push_back(endpoint.interval);
  }
}

}  // namespace

Bytes MakeUsbDescriptors(const UsbSpec& spec) {
  Bytes device = {18, 1, 0x00, 0x02, spec.device_class, 0, 0, 64};
  PutWord(spec.vendor, device);
  PutWord(spec.product, device);
  device.insert(device.end(), {0x00, 0x01, 0, 0, 0, 1});
  Bytes parts;
  for (std::size_t n = 0; n < spec.interfaces.size(); ++n) {
    PutInterface(spec.interfaces[n], n, parts);
  }
  Bytes configuration = {9, 2};
  PutWord(static_cast<unsigned>(9 + parts.size()), configuration);
  configuration.insert(configuration.end(),
                       {static_cast<std::uint8_t>(spec.interfaces.size()), 1, 0, 0xc0, 50});
  device.insert(device.end(), configuration.begin(), configuration.end());
  device.insert(device.end(), parts.begin(), parts.end());
  return device;
}

void EmulatedUsbDevice::QueueIn(std::uint8_t endpoint, Bytes bytes) {
  std::deque<Bytes>& queue = in_[endpoint];
  queue.push_back(std::move(bytes));
  if (queue.size() > kInQueueTransfers) queue.pop_front();
}

bool EmulatedUsbDevice::IsInEmpty(std::uint8_t endpoint) const {
  const auto queue = in_.find(endpoint);
  return queue == in_.end() || queue->second.empty();
}

std::optional<std::size_t> EmulatedUsbDevice::Control(const UsbSetup& setup,
                                                      std::span<std::uint8_t> data) {
  Bytes bytes = {setup.request_type, setup.request};
  for (const unsigned word : {setup.value, setup.index, setup.length}) PutWord(word, bytes);
  if (!(setup.request_type & 0x80)) bytes.insert(bytes.end(), data.begin(), data.end());
  Log(UsbEvent::Kind::kControl, setup.request, bytes);
  if (faults_.refuses_requests) return std::nullopt;
  if (setup.request_type != 0x80 || setup.request != 6 || setup.value != 0x0200) {
    return OnControl(setup, data);
  }
  constexpr std::size_t kDeviceDescriptorBytes = 18;
  const Bytes descriptors = MakeUsbDescriptors(spec_);
  const auto configuration = std::span(descriptors).subspan(kDeviceDescriptorBytes);
  const std::size_t count = std::min(configuration.size(), data.size());
  std::copy_n(configuration.begin(), count, data.begin());
  return count;
}

bool EmulatedUsbDevice::Out(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) {
  if (faults_.deaf) return false;
  Log(UsbEvent::Kind::kOut, endpoint, bytes);
  OnOut(endpoint, bytes);
  return true;
}

std::optional<Bytes> EmulatedUsbDevice::TakeIn(std::uint8_t endpoint) {
  std::deque<Bytes>& queue = in_[endpoint];
  if (faults_.silent) queue.clear();
  if (queue.empty()) return std::nullopt;
  Bytes packet = std::move(queue.front());
  queue.pop_front();
  ++in_transfers_;
  if (faults_.cut_in_to) packet.resize(std::min(packet.size(), *faults_.cut_in_to));
  if (const auto at = faults_.corrupt_in; at && *at < packet.size()) packet[*at] ^= 0xff;
  return packet;
}

void EmulatedUsbDevice::Log(UsbEvent::Kind kind, std::uint8_t number,
                            std::span<const std::uint8_t> bytes) {
  events_.push_back({.kind = kind, .number = number, .bytes = Bytes(bytes.begin(), bytes.end())});
}

}  // namespace palpate::test
