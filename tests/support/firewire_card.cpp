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

constexpr std::uint32_t kKernelVersion = 5, kVersionOfAutoFlush = 5;
constexpr std::size_t kPageBytes = 4096;
constexpr int kBandwidthUnits = 4915;
constexpr int kReceiveContexts = 4, kSendContexts = 8;
constexpr std::int64_t kGraceNs = 1'000'000'000;  // no new allocations after a bus reset
constexpr std::uint64_t kInvalidStampBits = 0x8411;
constexpr std::uint8_t kOldMemory = 0xee;
constexpr int kMostWithoutInterrupt = 4000;
// A mode does not stop root. Nobody, not even root, may write this file.
constexpr const char* kForbidden = "/proc/sys/kernel/osrelease";

using Kind = FirewireEvent::Kind;

void PutWord(std::uint64_t word, Bytes& bytes) {
  for (int shift = 24; shift >= 0; shift -= 8) {
    bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  }
}

// `bytes`: how much of it there is; data that follow may begin within the struct's padding.
template <class T>
Bytes EventBytes(const T& event, std::size_t bytes = sizeof(T)) {
  Bytes all(bytes);
  std::memcpy(all.data(), &event, std::min(bytes, sizeof(T)));
  return all;
}

std::uint32_t LengthOfHeader(std::uint32_t control) { return control >> 24; }
bool Skips(std::uint32_t control) { return (control & FW_CDEV_ISO_SKIP) != 0; }

// Copies `count` bytes to or from the place that the pointer at `offset` names. Returns false if
// there is none.
bool CopyFrom(UMockdevIoctlData* data, std::size_t offset, Bytes& bytes) {
  UMockdevIoctlData* there = umockdev_ioctl_data_resolve(data, offset, bytes.size(), nullptr);
  if (!there) return false;
  std::copy_n(there->data, bytes.size(), bytes.begin());
  umockdev_ioctl_data_unref(there);
  return true;
}
void CopyTo(UMockdevIoctlData* data, std::size_t offset, const Bytes& bytes) {
  UMockdevIoctlData* there = umockdev_ioctl_data_resolve(data, offset, bytes.size(), nullptr);
  if (!there) return;
  std::copy(bytes.begin(), bytes.end(), there->data);
  umockdev_ioctl_data_unref(there);
}

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

long FirewireNode::CreateContext(UMockdevIoctlClient* ioctl, Client& client) {
  auto request = ArgumentValue<fw_cdev_create_iso_context>(ioctl);
  const bool sends = request.type == FW_CDEV_ISO_CONTEXT_TRANSMIT;
  if (!sends && request.type != FW_CDEV_ISO_CONTEXT_RECEIVE) return -EINVAL;
  if (request.channel > 63 || (sends && request.speed > SCODE_3200)) return -EINVAL;
  if (!sends && (request.header_size < 4 || request.header_size % 4 != 0)) return -EINVAL;
  if (client.context || !card_.HasContextFor(sends, request.channel)) return -EBUSY;
  client.context = {.sends = sends,
                    .header_bytes = request.header_size,
                    .channel = request.channel,
                    .speed = request.speed,
                    .closure = request.closure};
  request.handle = 0;
  SetArgument(ioctl, request);
  Log({.kind = Kind::kCreate,
       .descriptor = client.number,
       .number = request.channel,
       .rcode = request.type});
  return 0;
}

long FirewireNode::QueueIso(UMockdevIoctlClient* ioctl, Client& client) {
  UMockdevIoctlData* data = Argument(ioctl, sizeof(fw_cdev_queue_iso));
  if (!data) return -EFAULT;
  const auto request = *reinterpret_cast<fw_cdev_queue_iso*>(data->data);
  Bytes bytes(request.size);
  const bool has_bytes = request.size == 0 || CopyFrom(data, 0, bytes);
  umockdev_ioctl_data_unref(data);
  if (!client.context || request.handle != 0) return -EINVAL;
  if (!has_bytes) return -EFAULT;
  Context& context = *client.context;
  long count = 0;
  for (std::size_t at = 0; at < bytes.size(); ++count) {
    if (at + 4 > bytes.size()) return -EFAULT;
    Queued one;
    std::memcpy(&one.control, bytes.data() + at, 4);
    at += 4;
    const std::uint32_t length = LengthOfHeader(one.control);
    if (context.sends) {
      if (length % 4 != 0 || at + length > bytes.size()) return -EINVAL;
      one.payload.assign(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                         bytes.begin() + static_cast<std::ptrdiff_t>(at + length));
      at += length;
    } else if (length == 0 || length % context.header_bytes != 0) {
      return -EINVAL;
    }
    const bool has_payload = (one.control & 0xffff) != 0;
    if (has_payload || (context.sends && Skips(one.control) && length > 0)) return -EINVAL;
    // A control word for several packets: its interrupt is that of the last one.
    const std::size_t packets = context.sends ? 1 : length / context.header_bytes;
    for (std::size_t n = 1; n < packets; ++n) {
      context.queued.push_back({.control = one.control & ~FW_CDEV_ISO_INTERRUPT});
    }
    context.queued.push_back(std::move(one));
  }
  return count;
}

long FirewireNode::StartIso(UMockdevIoctlClient* ioctl, Client& client) {
  const auto request = ArgumentValue<fw_cdev_start_iso>(ioctl);
  if (!client.context || request.handle != 0) return -EINVAL;
  Context& context = *client.context;
  if (!context.sends && (request.tags == 0 || request.tags > 15 || request.sync > 15)) {
    return -EINVAL;
  }
  if (context.queued.empty()) return -ENODATA;
  context.tags = request.tags;
  context.runs = true;
  Log({.kind = Kind::kStart, .descriptor = client.number, .number = context.channel});
  return 0;
}

void FirewireNode::Complete(Client& client, Bytes header, unsigned stamp) {
  Context& context = *client.context;
  const bool interrupts = (context.queued.front().control & FW_CDEV_ISO_INTERRUPT) != 0;
  context.queued.pop_front();
  context.done.push_back({.header = std::move(header), .stamp = stamp, .interrupts = interrupts});
  context.since_interrupt = interrupts ? 0 : context.since_interrupt + 1;
  // Its memory is freed by interrupts only: the kernel ends such a context after minutes.
  if (context.since_interrupt == kMostWithoutInterrupt) Blame("packets without an interrupt");
  if (interrupts) Process(client);
}

void FirewireNode::Process(Client& client) {
  Context& context = *client.context;
  for (; !context.done.empty(); context.done.pop_front()) {
    const Done& one = context.done.front();
    if (context.header.size() + one.header.size() > kPageBytes) {
      if (client.version < kVersionOfAutoFlush) continue;
      Flush(client);
    }
    context.header.insert(context.header.end(), one.header.begin(), one.header.end());
    context.last_stamp = one.stamp;
    if (one.interrupts) Flush(client);
  }
}

void FirewireNode::Flush(Client& client) {
  Context& context = *client.context;
  fw_cdev_event_iso_interrupt event{};
  event.closure = context.closure;
  event.type = FW_CDEV_EVENT_ISO_INTERRUPT;
  event.cycle = context.last_stamp;
  event.header_length = static_cast<std::uint32_t>(context.header.size());
  Bytes bytes = EventBytes(event, sizeof(event) + context.header.size());
  std::copy(context.header.begin(), context.header.end(),
            bytes.begin() + offsetof(fw_cdev_event_iso_interrupt, header));
  context.header.clear();
  QueueEvent(client, std::move(bytes));
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

void FirewireCard::SetFaults(const FirewireFaults& faults) {
  const std::scoped_lock lock(mutex_);
  faults_ = faults;
}

void FirewireCard::Add(std::unique_ptr<FirewireNode> node) {
  const std::scoped_lock lock(mutex_);
  {
    const std::scoped_lock device_lock(node->device_.mutex_);
    node->device_.OnPlugged();
  }
  Reset(nullptr);
  nodes_.push_back(std::move(node));
}

void FirewireCard::Remove(FirewireNode& node) {
  const std::scoped_lock lock(mutex_);
  node.Pull();
  Reset(&node);
}

void FirewireCard::BusReset() {
  const std::scoped_lock lock(mutex_);
  Reset(nullptr);
  allocations_from_ns_ = NowNs() + kGraceNs;
}

void FirewireCard::Reset(const FirewireNode* without) {
  ++generation_;
  for (const auto& node : nodes_) {
    if (node->gone_ || node.get() == without) continue;
    node->AfterReset();
    node->SetPipe();
  }
}

void FirewireCard::Millisecond() {
  const std::scoped_lock lock(mutex_);
  const bool may_allocate = NowNs() >= allocations_from_ns_;
  for (const auto& node : nodes_) {
    for (auto& [ioctl, client] : node->clients_) {
      for (auto& [handle, resource] : client.resources) {
        if (resource.waits && may_allocate) node->TryAllocate(handle, resource, client);
      }
      // What the kernel did not get is no resource.
      std::erase_if(client.resources, [](const auto& one) {
        return !one.second.waits && one.second.channel < 0 && one.second.bandwidth == 0;
      });
    }
  }
  for (int n = 0; n < 8; ++n) Cycle();
  for (const auto& node : nodes_) node->SetPipe();
}

void FirewireCard::Cycle() {
  ++cycle_;
  for (const auto& node : nodes_) {
    if (node->gone_) continue;
    std::optional<FirewirePacket> packet;
    {
      const std::scoped_lock lock(node->device_.mutex_);
      packet = node->device_.OnCycle(cycle_);
    }
    if (packet) Deliver(node->device_, *packet);
  }
  for (const auto& node : nodes_) {
    for (auto& [ioctl, client] : node->clients_) {
      const auto& context = client.context;
      if (context && context->sends && context->runs && !context->queued.empty()) {
        Send(*node, client);
      }
    }
  }
}

unsigned FirewireCard::Stamp() const {
  return static_cast<unsigned>((cycle_ / 8000 % 8) << 13 | cycle_ % 8000);
}

void FirewireCard::Deliver(EmulatedFirewireDevice& from, const FirewirePacket& packet) {
  Bytes header;
  PutWord(packet.payload.size() << 16 | packet.tag << 14 | packet.channel << 8 |
              TCODE_STREAM_DATA << 4 | packet.sy,
          header);
  PutWord(kInvalidStampBits << 16 | Stamp(), header);
  header.insert(header.end(), packet.payload.begin(), packet.payload.end());
  FirewireCounts counts{.unheard = 1};
  for (const auto& node : nodes_) {
    for (auto& [ioctl, client] : node->clients_) {
      const auto& context = client.context;
      if (!context || context->sends || !context->runs || context->channel != packet.channel ||
          (context->tags >> packet.tag & 1) == 0) {
        continue;
      }
      counts = {.lost = 1};
      if (context->queued.empty()) continue;
      counts = {.delivered = 1};
      Bytes slot = header;
      slot.resize(context->header_bytes, kOldMemory);
      node->Complete(client, std::move(slot), Stamp());
    }
  }
  const std::scoped_lock lock(from.mutex_);
  from.counts_.delivered += counts.delivered;
  from.counts_.lost += counts.lost;
  from.counts_.unheard += counts.unheard;
}

void FirewireCard::Send(FirewireNode& node, FirewireNode::Client& client) {
  const FirewireNode::Context& context = *client.context;
  const FirewireNode::Queued& first = context.queued.front();
  const FirewirePacket packet{.channel = context.channel,
                              .tag = first.control >> 18 & 3,
                              .sy = first.control >> 20 & 15,
                              .speed = context.speed,
                              .payload = first.payload};
  for (const auto& other : nodes_) {
    if (other->gone_ || Skips(first.control)) continue;
    const std::scoped_lock lock(other->device_.mutex_);
    other->device_.OnPacket(packet, cycle_);
  }
  Bytes header;
  PutWord(kInvalidStampBits << 16 | Stamp(), header);
  node.Complete(client, std::move(header), Stamp());
}

bool FirewireCard::HasContextFor(bool sends, unsigned channel) const {
  int used = 0;
  for (const auto& node : nodes_) {
    for (const auto& [ioctl, client] : node->clients_) {
      if (!client.context || client.context->sends != sends) continue;
      if (!sends && client.context->channel == channel) return false;
      ++used;
    }
  }
  return used < (sends ? kSendContexts : kReceiveContexts);
}

}  // namespace palpate::test
