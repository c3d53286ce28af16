// A node's descriptors: what they ask for, and what they read. firewire_card.cpp has the
// isochronous contexts.
#include "tests/support/firewire_card.h"

#include <fcntl.h>
#include <linux/firewire-cdev.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <stdexcept>
#include <utility>

namespace palpate::test {
namespace {

constexpr std::uint32_t kKernelVersion = 5;
constexpr int kBandwidthUnits = 4915;

using Kind = FirewireEvent::Kind;

// Hidden from who lists /dev.
std::string PipeOf(const std::string& path) {
  const std::filesystem::path node = path;
  return node.parent_path() / ("." + node.filename().string());
}

}  // namespace

FirewireNode::FirewireNode(FirewireCard& card, EmulatedFirewireDevice& device, std::string path,
                           bool is_local)
    : card_(card),
      device_(device),
      path_(std::move(path)),
      pipe_path_(PipeOf(path_)),
      is_local_(is_local) {
  if (mkfifo(pipe_path_.c_str(), 0600) != 0) throw std::runtime_error("cannot make " + pipe_path_);
  pipe_ = open(pipe_path_.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (pipe_ < 0) throw std::runtime_error("cannot use " + pipe_path_);
  chmod(pipe_path_.c_str(), 0666);
  SetMayOpen(true);
}

FirewireNode::~FirewireNode() { close(pipe_); }

void FirewireNode::SetMayOpen(bool may_open) {
  unlink(path_.c_str());
  if (symlink(may_open ? pipe_path_.c_str() : kForbidden, path_.c_str()) != 0) {
    throw std::runtime_error("cannot make " + path_);
  }
}

void FirewireNode::Millisecond() {
  if (is_local_) card_.Millisecond();
}

void FirewireNode::HandleIoctl(UMockdevIoctlClient* client) {
  long result = 0;
  {
    const std::scoped_lock lock(card_.mutex_);
    result = gone_ ? -ENODEV : Answer(client);
    SetPipe();
  }
  umockdev_ioctl_client_complete(client, result < 0 ? -1 : result,
                                 result < 0 ? static_cast<int>(-result) : 0);
}

bool FirewireNode::HandleRead(UMockdevIoctlClient* ioctl) {
  long result = -1;
  int error = 0;
  {
    const std::scoped_lock lock(card_.mutex_);
    Client& client = ClientOf(ioctl);
    UMockdevIoctlData* buffer = umockdev_ioctl_client_get_arg(ioctl);
    if (!client.events.empty()) {
      const Bytes event = std::move(client.events.front());
      client.events.pop_front();
      const auto room = static_cast<std::size_t>(buffer->data_len);
      // Up to 4 bytes at an event's end may be padding.
      if (room + 4 < event.size()) Blame("read an event into a buffer that is too small");
      result = static_cast<long>(std::min(event.size(), room));
      umockdev_ioctl_data_update(buffer, 0, const_cast<guint8*>(event.data()),
                                 static_cast<gint>(result));
    } else if (gone_) {
      error = ENODEV;
    } else {
      if (!client.may_read_nothing) Blame("read without an event: the kernel would wait");
      error = EAGAIN;
    }
    client.may_read_nothing = std::ranges::any_of(clients_, [&](const auto& other) {
      return &other.second != &client && !other.second.events.empty();
    });
    SetPipe();
  }
  umockdev_ioctl_client_complete(ioctl, result, error);
  return true;
}

void FirewireNode::Closed(UMockdevIoctlClient* ioctl) {
  const std::scoped_lock lock(card_.mutex_);
  const auto found = clients_.find(ioctl);
  if (found == clients_.end()) return;
  while (!found->second.resources.empty()) {
    Release(found->second.resources.begin()->first, found->second);
  }
  Log({.kind = Kind::kClose, .descriptor = found->second.number});
  clients_.erase(found);
  SetPipe();
}

FirewireNode::Client& FirewireNode::ClientOf(UMockdevIoctlClient* ioctl) {
  const auto [place, is_new] = clients_.try_emplace(ioctl);
  // Not when it connects: umockdev does that for an open that fails, too.
  if (is_new) {
    place->second.number = opens_++;
    Log({.kind = Kind::kOpen, .descriptor = place->second.number});
  }
  return place->second;
}

long FirewireNode::Answer(UMockdevIoctlClient* ioctl) {
  Client& client = ClientOf(ioctl);
  const unsigned long request = umockdev_ioctl_client_get_request(ioctl);
  const bool has_context = client.context.has_value();
  switch (request) {
    case FW_CDEV_IOC_GET_INFO:
      return GetInfo(ioctl, client);
    case FW_CDEV_IOC_GET_SPEED:
      return SCODE_400;
    case FW_CDEV_IOC_SEND_REQUEST:
      return SendRequest(ioctl, client);
    case FW_CDEV_IOC_ALLOCATE_ISO_RESOURCE:
      return Allocate(ioctl, client);
    case FW_CDEV_IOC_DEALLOCATE_ISO_RESOURCE:
      return Deallocate(ArgumentValue<fw_cdev_deallocate>(ioctl).handle, client);
    case FW_CDEV_IOC_CREATE_ISO_CONTEXT:
      return CreateContext(ioctl, client);
    case FW_CDEV_IOC_QUEUE_ISO:
      return QueueIso(ioctl, client);
    case FW_CDEV_IOC_START_ISO:
      return StartIso(ioctl, client);
    case FW_CDEV_IOC_STOP_ISO:
      if (!has_context || ArgumentValue<fw_cdev_stop_iso>(ioctl).handle != 0) return -EINVAL;
      client.context->runs = false;
      Log({.kind = Kind::kStop, .descriptor = client.number, .number = client.context->channel});
      return 0;
    case FW_CDEV_IOC_FLUSH_ISO:
      if (!has_context || ArgumentValue<fw_cdev_flush_iso>(ioctl).handle != 0) return -EINVAL;
      Process(client);
      if (!client.context->header.empty()) Flush(client);
      return 0;
    case FW_CDEV_IOC_GET_CYCLE_TIMER:
    case FW_CDEV_IOC_GET_CYCLE_TIMER2:
      Blame("GET_CYCLE_TIMER");
      return -ENOTTY;
    default:
      Blame("ioctl " + std::to_string(_IOC_NR(request)));
      return -ENOTTY;
  }
}

fw_cdev_event_bus_reset FirewireNode::ResetEvent(const Client& client) const {
  fw_cdev_event_bus_reset event{};
  event.closure = client.reset_closure;
  event.type = FW_CDEV_EVENT_BUS_RESET;
  event.node_id = 0xffc0;
  event.local_node_id = event.bm_node_id = event.irm_node_id = event.root_node_id = 0xffc1;
  event.generation = card_.generation_;
  return event;
}

long FirewireNode::GetInfo(UMockdevIoctlClient* ioctl, Client& client) {
  UMockdevIoctlData* data = Argument(ioctl, sizeof(fw_cdev_get_info));
  if (!data) return -EFAULT;
  // The kernel keeps the ROM in the host's byte order. Its check sums are left out.
  const std::uint64_t guid = device_.guid_;
  const std::uint32_t rom[] = {0x04040000,
                               0x31333934,
                               0xe0648000,
                               static_cast<std::uint32_t>(guid >> 32),
                               static_cast<std::uint32_t>(guid),
                               0x00020000,
                               0x03000000 | static_cast<std::uint32_t>(guid >> 40),
                               0x17000000};
  auto info = *reinterpret_cast<fw_cdev_get_info*>(data->data);
  client.version = info.version;
  client.hears_resets = true;
  client.reset_closure = info.bus_reset_closure;
  if (info.rom != 0 && info.rom_length != 0) {
    CopyTo(data, offsetof(fw_cdev_get_info, rom),
           EventBytes(rom, std::min<std::size_t>(info.rom_length, sizeof(rom))));
  }
  constexpr std::size_t kResetBytes = 36;
  if (info.bus_reset != 0) {
    CopyTo(data, offsetof(fw_cdev_get_info, bus_reset),
           EventBytes(ResetEvent(client), kResetBytes));
  }
  auto& answer = *reinterpret_cast<fw_cdev_get_info*>(data->data);
  answer.version = kKernelVersion;
  answer.rom_length = sizeof(rom);
  answer.card = 0;
  umockdev_ioctl_data_unref(data);
  return 0;
}

long FirewireNode::SendRequest(UMockdevIoctlClient* ioctl, Client& client) {
  UMockdevIoctlData* data = Argument(ioctl, sizeof(fw_cdev_send_request));
  if (!data) return -EFAULT;
  const auto request = *reinterpret_cast<fw_cdev_send_request*>(data->data);
  Bytes bytes(std::min<std::size_t>(request.length, kPageBytes));
  const bool has_bytes = request.data != 0 && request.length != 0 &&
                         CopyFrom(data, offsetof(fw_cdev_send_request, data), bytes);
  umockdev_ioctl_data_unref(data);
  const bool writes_quadlet = request.tcode == TCODE_WRITE_QUADLET_REQUEST;
  const bool writes = writes_quadlet || request.tcode == TCODE_WRITE_BLOCK_REQUEST;
  const bool reads_quadlet = request.tcode == TCODE_READ_QUADLET_REQUEST;
  if (!writes && !reads_quadlet && request.tcode != TCODE_READ_BLOCK_REQUEST) return -EINVAL;
  if (request.length > 512U << SCODE_400) return -EIO;
  if (writes_quadlet && request.length < 4) return -EINVAL;
  if (writes && !has_bytes) Blame("wrote without data");

  std::uint32_t rcode = RCODE_GENERATION;
  if (request.generation == card_.generation_) {
    if (writes_quadlet || reads_quadlet) bytes.resize(4);
    const std::scoped_lock lock(device_.mutex_);
    rcode = device_.Request(client.number, writes, request.offset,
                            !writes_quadlet && !reads_quadlet, bytes);
  }
  if (rcode == kNoResponse) return 0;
  fw_cdev_event_response response{};
  response.closure = request.closure;
  response.type = FW_CDEV_EVENT_RESPONSE;
  response.rcode = rcode;
  if (!writes && rcode == RCODE_COMPLETE) {
    response.length = std::min(request.length, static_cast<std::uint32_t>(bytes.size()));
  }
  // As the kernel's event: longer than its data, which begin within the struct's padding. (The
  // kernel repeats up to 4 bytes after the struct; nobody should rely on that.)
  constexpr std::size_t kDataAt = offsetof(fw_cdev_event_response, data);
  Bytes event = EventBytes(response, sizeof(response) + response.length);
  std::copy_n(bytes.begin(), response.length, event.begin() + kDataAt);
  QueueEvent(client, std::move(event));
  return 0;
}

long FirewireNode::Allocate(UMockdevIoctlClient* ioctl, Client& client) {
  auto request = ArgumentValue<fw_cdev_allocate_iso_resource>(ioctl);
  if ((request.channels == 0 && request.bandwidth == 0) || request.bandwidth > kBandwidthUnits) {
    return -EINVAL;
  }
  request.handle = client.next_handle++;
  client.resources[request.handle] = {.channels = request.channels,
                                      .closure = request.closure,
                                      .bandwidth = static_cast<int>(request.bandwidth)};
  SetArgument(ioctl, request);
  return 0;
}

namespace {

Bytes ResourceEvent(std::uint32_t type, std::uint64_t closure, std::uint32_t handle, int channel,
                    int bandwidth) {
  fw_cdev_event_iso_resource event{};
  event.closure = closure;
  event.type = type;
  event.handle = handle;
  event.channel = channel;
  event.bandwidth = bandwidth;
  return EventBytes(event);
}

}  // namespace

void FirewireNode::TryAllocate(std::uint32_t handle, Resource& resource, Client& client) {
  const std::uint64_t unused = ~(card_.used_channels_ | card_.faults_.taken_channels);
  int channel = resource.channels == 0 ? -EINVAL : -EBUSY;
  if ((resource.channels & unused) != 0) channel = std::countr_zero(resource.channels & unused);
  const bool is_too_much =
      card_.faults_.no_bandwidth || card_.used_bandwidth_ + resource.bandwidth > kBandwidthUnits;
  if (resource.bandwidth > 0 && is_too_much) channel = -EBUSY;
  const bool has_failed = channel == -EBUSY;
  if (has_failed) resource.bandwidth = 0;
  resource.waits = false;
  resource.channel = channel;
  if (channel >= 0) card_.used_channels_ |= 1ULL << channel;
  card_.used_bandwidth_ += resource.bandwidth;
  Log({.kind = Kind::kAllocate, .descriptor = client.number, .number = channel});
  QueueEvent(client, ResourceEvent(FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED, resource.closure, handle,
                                   channel, resource.bandwidth));
}

long FirewireNode::Deallocate(std::uint32_t handle, Client& client) {
  const auto found = client.resources.find(handle);
  if (found == client.resources.end()) return -EINVAL;
  const Resource resource = found->second;
  Release(handle, client);
  QueueEvent(client, ResourceEvent(FW_CDEV_EVENT_ISO_RESOURCE_DEALLOCATED, resource.closure, handle,
                                   resource.channel, resource.bandwidth));
  return 0;
}

void FirewireNode::Release(std::uint32_t handle, Client& client) {
  const auto found = client.resources.find(handle);
  const Resource resource = found->second;
  client.resources.erase(found);
  if (resource.waits) return;
  if (resource.channel >= 0) card_.used_channels_ &= ~(1ULL << resource.channel);
  card_.used_bandwidth_ -= resource.bandwidth;
  Log({.kind = Kind::kFree, .descriptor = client.number, .number = resource.channel});
}

void FirewireNode::QueueEvent(Client& client, Bytes event) {
  client.events.push_back(std::move(event));
  for (auto& [ioctl, other] : clients_) {
    if (&other != &client) other.may_read_nothing = true;
  }
}

void FirewireNode::SetPipe() {
  const bool full = gone_ || std::ranges::any_of(clients_, [](const auto& client) {
                      return !client.second.events.empty();
                    });
  if (full == pipe_full_) return;
  char byte = 0;
  if ((full ? write(pipe_, &byte, 1) : read(pipe_, &byte, 1)) == 1) pipe_full_ = full;
}

void FirewireNode::AfterReset() {
  for (auto& [ioctl, client] : clients_) {
    if (client.hears_resets) QueueEvent(client, EventBytes(ResetEvent(client)));
    if (!card_.faults_.loses_channels_at_reset) continue;
    const auto held = client.resources;
    for (const auto& [handle, resource] : held) {
      if (resource.waits) continue;
      Release(handle, client);
      QueueEvent(client, ResourceEvent(FW_CDEV_EVENT_ISO_RESOURCE_DEALLOCATED, resource.closure,
                                       handle, -EBUSY, 0));
    }
  }
  const std::scoped_lock lock(device_.mutex_);
  device_.Log({.kind = Kind::kBusReset, .number = card_.generation_});
  device_.OnBusReset();
}

void FirewireNode::Pull() {
  gone_ = true;
  SetPipe();
  unlink(path_.c_str());
}

void FirewireNode::Log(FirewireEvent event) {
  const std::scoped_lock lock(device_.mutex_);
  device_.Log(std::move(event));
}

void FirewireNode::Blame(const std::string& mistake) {
  const std::scoped_lock lock(device_.mutex_);
  device_.Blame(mistake);
}

}  // namespace palpate::test
