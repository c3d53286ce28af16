// An emulated FireWire device: its registers, its isochronous packets, its faults, and a log of
// what the host does with its node. FirewireTestbed plugs it into a bus.
//
// It proves behaviour, not timing, and nothing about hardware: it is only as true as our knowledge
// of a device.
//
// Threads: tests on any thread. The testbed's threads call the model's own functions (On...), one
// at a time, with mutex() held.
#pragma once

#include <linux/firewire-constants.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tests/support/emulated.h"

namespace palpate::test {

// Besides the kernel's RCODE_...: no answer comes at all.
inline constexpr std::uint32_t kNoResponse = 0xffff;

// The host's actions on a device's node, in order.
struct FirewireEvent {
  enum class Kind : std::uint8_t {
    kOpen,
    kClose,
    kRead,      // number: address; bytes: those that were read
    kWrite,     // number: address; bytes: those that were written
    kAllocate,  // number: channel, or -errno
    kFree,      // number: channel
    kCreate,    // number: channel; rcode: FW_CDEV_ISO_CONTEXT_...
    kStart,     // number: channel
    kStop,      // number: channel
    kBusReset,  // number: the new generation
  };
  Kind kind = Kind::kOpen;
  int descriptor = -1;  // the number of its open, from 0
  std::int64_t number = 0;
  Bytes bytes{};
  std::uint32_t rcode = RCODE_COMPLETE;  // of a read or write: with another, it did nothing
  std::int64_t time_ns = 0;
};

struct FirewirePacket {
  unsigned channel = 0, tag = 0, sy = 0, speed = SCODE_400;
  Bytes payload{};
};

struct FirewireCounts {
  std::uint64_t lost = 0;  // no receive descriptor was queued
};

// Faults of the bus's isochronous resources.
struct FirewireFaults {
  std::uint64_t taken_channels = 0;  // bit n: another program has channel n
  bool no_bandwidth = false;
  bool loses_channels_at_reset = false;  // the kernel does not get them again
};

// By itself: a device without registers, such as the host's controller or a camera.
class EmulatedFirewireDevice {
 public:
  explicit EmulatedFirewireDevice(std::uint64_t guid) : guid_(guid) {}
  virtual ~EmulatedFirewireDevice() = default;
  EmulatedFirewireDevice(const EmulatedFirewireDevice&) = delete;
  EmulatedFirewireDevice& operator=(const EmulatedFirewireDevice&) = delete;

  std::uint64_t guid() const { return guid_; }

  // The next requests get this rcode and have no effect. With an address: only those there.
  void AnswerNext(int requests, std::uint32_t rcode, std::optional<std::uint64_t> address = {});

  std::vector<FirewireEvent> Events() const;
  std::size_t CountOf(FirewireEvent::Kind kind) const {
    return static_cast<std::size_t>(std::ranges::count(Events(), kind, &FirewireEvent::kind));
  }
  FirewireCounts Counts() const;
  // What no driver may do, and how often it was done. A test expects none.
  std::map<std::string, int> Mistakes() const;

 protected:
  std::mutex& mutex() const { return mutex_; }

  virtual void OnPlugged() {}
  virtual void OnBusReset() {}
  // Return an rcode. block: a block transaction, not a quadlet one.
  virtual std::uint32_t OnRead(std::uint64_t, bool /*block*/, std::span<std::uint8_t>) {
    return RCODE_ADDRESS_ERROR;
  }
  virtual std::uint32_t OnWrite(std::uint64_t, bool /*block*/, std::span<const std::uint8_t>) {
    return RCODE_ADDRESS_ERROR;
  }
  // Called each 125 us of the bus. Returns what the device sends in this cycle.
  virtual std::optional<FirewirePacket> OnCycle(std::uint64_t /*cycle*/) { return std::nullopt; }
  // Each isochronous packet of others on the bus.
  virtual void OnPacket(const FirewirePacket&, std::uint64_t /*cycle*/) {}

  void Blame(const std::string& mistake) { ++mistakes_[mistake]; }

 private:
  // These hold the mutex.
  friend class FirewireCard;
  friend class FirewireNode;

  std::uint32_t Request(int descriptor, bool write, std::uint64_t address, bool block,
                        std::span<std::uint8_t> data);
  void Log(FirewireEvent event);

  const std::uint64_t guid_;
  mutable std::mutex mutex_;
  int faulty_requests_ = 0;
  std::uint32_t fault_ = RCODE_COMPLETE;
  std::optional<std::uint64_t> faulty_address_;
  std::vector<FirewireEvent> events_;
  FirewireCounts counts_;
  std::map<std::string, int> mistakes_;
};

}  // namespace palpate::test
