#include "server/device/firewire/fw_node.h"

#include <fcntl.h>
#include <linux/firewire-cdev.h>
#include <linux/firewire-constants.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>

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

namespace {

namespace fs = std::filesystem;

std::string FirstLine(const fs::path& file) {
  std::string line;
  std::ifstream stream(file);
  std::getline(stream, line);
  return line;
}

// Calls take(folder, is_local) for each node. Units, fw1.0, are none.
template <class Take>
void ForEachNode(Take take) {
  std::error_code none;
  for (const fs::directory_entry& entry :
       fs::directory_iterator("/sys/bus/firewire/devices", none)) {
    const std::string name = entry.path().filename();
    if (!name.starts_with("fw") || name.find('.') != std::string::npos) continue;
    take(entry.path(), FirstLine(entry.path() / "is_local") == "1");
  }
}

std::optional<std::uint64_t> GuidOf(const fs::path& folder) {
  const std::string text = FirstLine(folder / "guid");  // "0x000b990080df6000"
  if (!text.starts_with("0x")) return std::nullopt;
  std::uint64_t guid = 0;
  const auto [end, error] = std::from_chars(text.data() + 2, text.data() + text.size(), guid, 16);
  if (error != std::errc()) return std::nullopt;
  return guid;
}

}  // namespace

std::vector<FwFound> FindFwNodes(std::uint32_t vendor) {
  constexpr int kVendorShift = 40;
  std::vector<FwFound> found;
  ForEachNode([&](const fs::path& folder, bool is_local) {
    const std::optional<std::uint64_t> guid = GuidOf(folder);
    if (is_local || !guid || *guid >> kVendorShift != vendor) return;
    const std::string node = "/dev/" + folder.filename().string();
    found.push_back({*guid, node, access(node.c_str(), R_OK | W_OK) == 0});
  });
  std::ranges::sort(found, {}, &FwFound::guid);
  return found;
}

bool HasFwController() {
  bool has = false;
  ForEachNode([&](const fs::path&, bool is_local) { has = has || is_local; });
  return has;
}

namespace {

constexpr std::uint32_t kAbi = 5;  // without later kinds of events
constexpr std::size_t kQuadlet = 4;

std::uint64_t PointerTo(const void* data) { return reinterpret_cast<std::uintptr_t>(data); }

[[noreturn]] void ThrowErrno(const std::string& what) {
  const int error = errno;
  if (error == ENODEV || error == ENOENT || error == ENXIO || error == ESHUTDOWN) {
    throw BusError(BusFault::kAbsent, "unplugged");
  }
  if (error == EACCES || error == EPERM) {
    throw BusError(BusFault::kPermission, std::string(kPermissionHint));
  }
  throw BusError(error == EBUSY ? BusFault::kBusy : BusFault::kBroken,
                 what + " failed: " + std::strerror(error));
}

}  // namespace

FwNode::FwNode(const std::string& path) : descriptor_(open(path.c_str(), O_RDWR | O_CLOEXEC)) {
  if (descriptor_ < 0) ThrowErrno("opening " + path);
}

FwNode::~FwNode() { close(descriptor_); }

int FwNode::Call(unsigned long request, void* argument, const char* what) {
  int result = 0;
  do {
    result = ioctl(descriptor_, request, argument);
  } while (result < 0 && errno == EINTR);
  if (result < 0) ThrowErrno(what);
  return result;
}

std::uint32_t FwNode::GetInfo() {
  fw_cdev_event_bus_reset bus{};
  fw_cdev_get_info info{};
  info.version = kAbi;
  info.bus_reset = PointerTo(&bus);
  Call(FW_CDEV_IOC_GET_INFO, &info, "asking the FireWire node");
  return bus.generation;
}

void FwNode::Ask(const Request& request, std::uint32_t tcode, std::size_t bytes, const void* data) {
  fw_cdev_send_request sent{};
  sent.tcode = tcode;
  sent.length = static_cast<std::uint32_t>(bytes);
  sent.offset = request.address;
  sent.closure = request.number;
  sent.data = PointerTo(data);
  sent.generation = request.generation;
  Call(FW_CDEV_IOC_SEND_REQUEST, &sent, "asking for a register");
}

void FwNode::AskToRead(const Request& request, std::size_t bytes) {
  Ask(request, bytes == kQuadlet ? TCODE_READ_QUADLET_REQUEST : TCODE_READ_BLOCK_REQUEST, bytes,
      nullptr);
}

void FwNode::AskToWrite(const Request& request, std::span<const std::uint8_t> data) {
  Ask(request, data.size() == kQuadlet ? TCODE_WRITE_QUADLET_REQUEST : TCODE_WRITE_BLOCK_REQUEST,
      data.size(), data.data());
}

void FwNode::AskForChannel(std::uint64_t channels, std::size_t packet_bytes) {
  // A quadlet at 100 Mbit/s takes 16 units; each packet costs 3 quadlets and 512 units more.
  constexpr std::size_t kUnitsPerByte = 4, kHeaderBytes = 12, kOverhead = 512;
  fw_cdev_allocate_iso_resource resource{};
  resource.channels = channels;
  resource.bandwidth =
      static_cast<std::uint32_t>((kHeaderBytes + packet_bytes) * kUnitsPerByte + kOverhead);
  Call(FW_CDEV_IOC_ALLOCATE_ISO_RESOURCE, &resource, "asking for a channel");
}

void FwNode::Create(std::uint32_t type, std::uint32_t header_bytes, int channel) {
  fw_cdev_create_iso_context context{};
  context.type = type;
  context.header_size = header_bytes;
  context.channel = static_cast<std::uint32_t>(channel);
  context.speed = SCODE_100;
  Call(FW_CDEV_IOC_CREATE_ISO_CONTEXT, &context,
       "using the FireWire controller (do other programs use all of its contexts?)");
  context_ = context.handle;
}

void FwNode::CreateReceiver(int channel) {
  Create(FW_CDEV_ISO_CONTEXT_RECEIVE, kFwPacketHeaderBytes, channel);
}

void FwNode::CreateSender(int channel) { Create(FW_CDEV_ISO_CONTEXT_TRANSMIT, 0, channel); }

void FwNode::Queue(std::span<const std::uint32_t> controls, int packets) {
  fw_cdev_queue_iso queue{};
  queue.packets = PointerTo(controls.data());
  queue.size = static_cast<std::uint32_t>(controls.size_bytes());
  queue.handle = context_;
  // If something within is wrong, the kernel takes fewer and says no more.
  if (Call(FW_CDEV_IOC_QUEUE_ISO, &queue, "queueing packets") != packets) {
    throw BusError(BusFault::kBroken, "the kernel does not take all packets");
  }
}

void FwNode::Start() {
  fw_cdev_start_iso start{};
  start.cycle = -1;
  start.tags = FW_CDEV_ISO_CONTEXT_MATCH_ALL_TAGS;
  start.handle = context_;
  Call(FW_CDEV_IOC_START_ISO, &start, "starting the stream");
}

void FwNode::Stop() noexcept {
  fw_cdev_stop_iso stop{};
  stop.handle = context_;
  ioctl(descriptor_, FW_CDEV_IOC_STOP_ISO, &stop);
}

std::size_t FwNode::Read(std::span<std::uint8_t> event) {
  const ssize_t got = read(descriptor_, event.data(), event.size());
  if (got >= 0) return static_cast<std::size_t>(got);
  if (errno == EAGAIN || errno == EINTR) return 0;
  ThrowErrno("reading from the FireWire node");
}

}  // namespace palpate
