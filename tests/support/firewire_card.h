// A FireWire card and the nodes of its bus, as the kernel's core-cdev.c and ohci.c (v6.1) show them
// by linux/firewire-cdev.h. A part of FirewireTestbed.
//
// What differs from the kernel:
// - A read without an event fails with EAGAIN, where the kernel waits. The pipe that stands for a
//   node wakes all descriptors of the node, so a poll may be wrong; a read that no poll can have
//   caused is a mistake of the driver (EmulatedFirewireDevice::Mistakes).
// - After the end of the device, poll reports POLLIN and not POLLHUP.
// - QUEUE_ISO does not write back its pointers. There is no mmap, so no payload outside headers.
//
// Threads: HandleIoctl, HandleRead and Closed on umockdev's thread, Millisecond on the bus's, the
// rest on the test's. All run under the card's mutex, and take the device's after it.
#pragma once

#include <algorithm>
#include <cstring>
#include <deque>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "tests/support/firewire_emulator.h"
#include "tests/support/umockdev_bus.h"

struct fw_cdev_event_bus_reset;

namespace palpate::test {

class FirewireCard;

constexpr std::size_t kPageBytes = 4096;

// `bytes`: how much of it there is; data that follow may begin within the struct's padding.
template <class T>
Bytes EventBytes(const T& event, std::size_t bytes = sizeof(T)) {
  Bytes all(bytes);
  std::memcpy(all.data(), &event, std::min(bytes, sizeof(T)));
  return all;
}

// A node of /dev, and all its open descriptors.
class FirewireNode final : public UmockdevNode {
 public:
  // `path`: that of the node in the testbed's folder. is_local: it is the card's own, and the
  // card's time is this node's.
  FirewireNode(FirewireCard& card, EmulatedFirewireDevice& device, std::string path, bool is_local);
  ~FirewireNode() override;
  FirewireNode(const FirewireNode&) = delete;
  FirewireNode& operator=(const FirewireNode&) = delete;

  void HandleIoctl(UMockdevIoctlClient* client) override;
  bool HandleRead(UMockdevIoctlClient* client) override;
  void Closed(UMockdevIoctlClient* client) override;
  void Millisecond() override;

  // Whether opens succeed, also those of root.
  void SetMayOpen(bool may_open);
  EmulatedFirewireDevice& device() { return device_; }

 private:
  friend class FirewireCard;

  struct Queued {
    std::uint32_t control = 0;
    Bytes payload{};  // of a packet to send
  };
  struct Done {
    Bytes header{};
    unsigned stamp = 0;
    bool interrupts = false;
  };
  struct Context {
    bool sends = false;
    std::size_t header_bytes = 0;
    unsigned channel = 0, speed = 0, tags = 0;
    std::uint64_t closure = 0;
    bool runs = false;
    int since_interrupt = 0;
    unsigned last_stamp = 0;
    std::deque<Queued> queued{};
    std::deque<Done> done{};  // the kernel has not looked at them
    Bytes header{};           // of the next event
  };
  struct Resource {
    std::uint64_t channels = 0, closure = 0;
    int bandwidth = 0;
    int channel = -1;
    bool waits = true;
  };
  // An open descriptor.
  struct Client {
    int number = 0;
    std::uint32_t version = 0;
    bool hears_resets = false;
    std::uint64_t reset_closure = 0;
    bool may_read_nothing = true;  // another descriptor's event has woken it
    std::deque<Bytes> events{};
    std::optional<Context> context{};
    std::map<std::uint32_t, Resource> resources{};
    std::uint32_t next_handle = 0;
  };

  // Returns the result, or -errno.
  long Answer(UMockdevIoctlClient* client);
  long GetInfo(UMockdevIoctlClient* ioctl, Client& client);
  long SendRequest(UMockdevIoctlClient* ioctl, Client& client);
  long Allocate(UMockdevIoctlClient* ioctl, Client& client);
  long Deallocate(std::uint32_t handle, Client& client);
  void Release(std::uint32_t handle, Client& client);
  long CreateContext(UMockdevIoctlClient* ioctl, Client& client);
  long QueueIso(UMockdevIoctlClient* ioctl, Client& client);
  long StartIso(UMockdevIoctlClient* ioctl, Client& client);

  void TryAllocate(std::uint32_t handle, Resource& resource, Client& client);
  void AfterReset();
  fw_cdev_event_bus_reset ResetEvent(const Client& client) const;
  void Pull();
  // Completes the context's first descriptor.
  void Complete(Client& client, Bytes header, unsigned stamp);
  void Process(Client& client);
  void Flush(Client& client);

  Client& ClientOf(UMockdevIoctlClient* ioctl);
  void QueueEvent(Client& client, Bytes event);
  // Wakes the host if there is something to read.
  void SetPipe();
  void Log(FirewireEvent event);
  void Blame(const std::string& mistake);

  FirewireCard& card_;
  EmulatedFirewireDevice& device_;
  const std::string path_, pipe_path_;
  const bool is_local_;
  int pipe_ = -1;
  bool pipe_full_ = false;
  bool gone_ = false;
  int opens_ = 0;
  std::map<UMockdevIoctlClient*, Client> clients_;
};

class FirewireCard {
 public:
  void SetFaults(const FirewireFaults& faults);
  // Plugs the node's device in, or out: others see a bus reset.
  void Add(std::unique_ptr<FirewireNode> node);
  void Remove(FirewireNode& node);
  void BusReset();
  void Millisecond();

 private:
  friend class FirewireNode;
  void Reset(const FirewireNode* without);
  void Cycle();
  void Deliver(EmulatedFirewireDevice& from, const FirewirePacket& packet);
  void Send(FirewireNode& node, FirewireNode::Client& client);
  bool HasContextFor(bool sends, unsigned channel) const;
  unsigned Stamp() const;

  std::mutex mutex_;
  FirewireFaults faults_;
  std::list<std::unique_ptr<FirewireNode>> nodes_;
  std::uint32_t generation_ = 1;
  std::int64_t allocations_from_ns_ = 0;
  std::uint64_t used_channels_ = 0;
  int used_bandwidth_ = 0;
  std::uint64_t cycle_ = 7000;
};

}  // namespace palpate::test
