// The isochronous side: contexts, the packets of each cycle, and the bus they go over.
#include "tests/support/firewire_card.h"

#include <linux/firewire-cdev.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <utility>

namespace palpate::test {
namespace {

constexpr std::uint32_t kVersionOfAutoFlush = 5;
constexpr int kReceiveContexts = 4, kSendContexts = 8;
constexpr std::int64_t kGraceNs = 1'000'000'000;  // no new allocations after a bus reset
constexpr std::uint64_t kInvalidStampBits = 0x8411;
constexpr std::uint8_t kOldMemory = 0xee;
constexpr int kMostWithoutInterrupt = 4000;

using Kind = FirewireEvent::Kind;

void PutWord(std::uint64_t word, Bytes& bytes) {
  for (int shift = 24; shift >= 0; shift -= 8) {
    bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  }
}

std::uint32_t LengthOfHeader(std::uint32_t control) { return control >> 24; }
bool Skips(std::uint32_t control) { return (control & FW_CDEV_ISO_SKIP) != 0; }

}  // namespace

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
  std::uint64_t lost = 0;
  for (const auto& node : nodes_) {
    for (auto& [ioctl, client] : node->clients_) {
      const auto& context = client.context;
      if (!context || context->sends || !context->runs || context->channel != packet.channel ||
          (context->tags >> packet.tag & 1) == 0) {
        continue;
      }
      lost = context->queued.empty() ? 1 : 0;
      if (lost > 0) continue;
      Bytes slot = header;
      slot.resize(context->header_bytes, kOldMemory);
      node->Complete(client, std::move(slot), Stamp());
    }
  }
  const std::scoped_lock lock(from.mutex_);
  from.counts_.lost += lost;
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
