#include "server/device/firewire/fw_event.h"

#include <linux/firewire-cdev.h>

#include <algorithm>
#include <cstring>

namespace palpate {
namespace {

// Numbers in the host's order, as the kernel's structures have them.
template <class T>
T At(std::span<const std::uint8_t> bytes, std::size_t at) noexcept {
  T value{};
  std::memcpy(&value, &bytes[at], sizeof value);
  return value;
}

std::uint32_t BigEndian(std::span<const std::uint8_t> bytes, std::size_t at) noexcept {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
}

// What follows the structure's fixed part. Its sizeof is larger, for its alignment.
std::optional<std::span<const std::uint8_t>> Rest(std::span<const std::uint8_t> bytes,
                                                  std::size_t from, std::size_t length) noexcept {
  if (length > bytes.size() - from) return std::nullopt;
  return bytes.subspan(from, length);
}

}  // namespace

std::optional<FwEvent> ParseFwEvent(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.size() < sizeof(fw_cdev_event_common)) return std::nullopt;
  using Reset = fw_cdev_event_bus_reset;
  using Response = fw_cdev_event_response;
  using Packets = fw_cdev_event_iso_interrupt;
  using Resource = fw_cdev_event_iso_resource;
  const auto type = At<std::uint32_t>(bytes, offsetof(fw_cdev_event_common, type));
  switch (type) {
    case FW_CDEV_EVENT_BUS_RESET: {
      if (bytes.size() < offsetof(Reset, generation) + 4) return std::nullopt;
      return FwBusReset{At<std::uint32_t>(bytes, offsetof(Reset, generation))};
    }
    case FW_CDEV_EVENT_RESPONSE: {
      if (bytes.size() < offsetof(Response, data)) return std::nullopt;
      const auto data = Rest(bytes, offsetof(Response, data),
                             At<std::uint32_t>(bytes, offsetof(Response, length)));
      if (!data) return std::nullopt;
      return FwResponse{At<std::uint64_t>(bytes, offsetof(Response, closure)),
                        At<std::uint32_t>(bytes, offsetof(Response, rcode)), *data};
    }
    case FW_CDEV_EVENT_ISO_INTERRUPT: {
      if (bytes.size() < offsetof(Packets, header)) return std::nullopt;
      const auto headers = Rest(bytes, offsetof(Packets, header),
                                At<std::uint32_t>(bytes, offsetof(Packets, header_length)));
      if (!headers) return std::nullopt;
      return FwPackets{*headers};
    }
    case FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED:
    case FW_CDEV_EVENT_ISO_RESOURCE_DEALLOCATED: {
      if (bytes.size() < offsetof(Resource, bandwidth) + 4) return std::nullopt;
      return FwResource{type == FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED,
                        At<std::int32_t>(bytes, offsetof(Resource, channel))};
    }
    default:
      return std::nullopt;
  }
}

std::optional<FwPacket> TakeFwPacket(std::span<const std::uint8_t>& headers) noexcept {
  if (headers.size() < kFwPacketHeaderBytes) return std::nullopt;
  FwPacket packet{.length = BigEndian(headers, 0) >> 16};
  const std::uint32_t time = BigEndian(headers, 4);
  packet.cycle = static_cast<int>((time >> 13 & 7) * 8000 + std::min(time & 0x1fff, 7999u));
  // Beyond a short packet's end the kernel leaves old memory.
  packet.payload = headers.subspan(8, std::min(packet.length, kFwPacketBytes));
  headers = headers.subspan(kFwPacketHeaderBytes);
  return packet;
}

}  // namespace palpate
