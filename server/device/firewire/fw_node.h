// FireWire through the kernel (linux/firewire-cdev.h): finds nodes, opens one, and tells its events
// as values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "server/device/stream/bus_error.h"

namespace palpate {

// The longest event with packets: the kernel collects at most a page of headers.
inline constexpr std::size_t kFwEventBytes = 4096 + 24;

// What of a received packet comes in its event: its header, its time, and this many bytes of it.
inline constexpr std::size_t kFwPacketBytes = 64;
inline constexpr std::size_t kFwPacketHeaderBytes = 8 + kFwPacketBytes;

struct FwBusReset {
  std::uint32_t generation = 0;
};
// Events of /dev/fw*: what read() returns, as values.
//
// Source: linux/firewire-cdev.h.
// Threads: pure functions. Real-time: no allocation, bounded.
struct FwResponse {
  std::uint64_t request = 0;  // its number
  std::uint32_t rcode = 0;
  std::span<const std::uint8_t> data{};
};
struct FwResource {
  bool allocated = false;  // false: given back, or lost after a bus reset
  int channel = -1;        // below 0: none
};
// Packets that a context has received or sent.
struct FwPackets {
  std::span<const std::uint8_t> headers{};
};
using FwEvent = std::variant<FwBusReset, FwResponse, FwResource, FwPackets>;

// `bytes`: what one read() gave. The result refers to them. None: another event, or one that is
// cut.
std::optional<FwEvent> ParseFwEvent(std::span<const std::uint8_t> bytes) noexcept;

struct FwPacket {
  std::span<const std::uint8_t> payload{};  // of longer packets the first kFwPacketBytes
  std::size_t length = 0;                   // as it was sent
  int cycle = 0;                            // of 1/8000 s, in 0 to kFwCycles - 1
};
inline constexpr int kFwCycles = 8 * 8000;

// Cuts the first received packet off `headers`. None: there is no whole one.
std::optional<FwPacket> TakeFwPacket(std::span<const std::uint8_t>& headers) noexcept;

// Looks for nodes of the machine's FireWire buses. Opens none.
//
// Threads: any. Not real-time. Errors: none; what cannot be read is not there.
struct FwFound {
  std::uint64_t guid = 0;
  std::string node{};     // "/dev/fw1"
  bool may_open = false;  // this user may open it
};

// The nodes of other machines and devices whose GUID begins with `vendor` (24 bits), by GUID.
std::vector<FwFound> FindFwNodes(std::uint32_t vendor);

// Whether this machine has a FireWire controller with a driver.
bool HasFwController();

// One open descriptor of a FireWire node: the kernel's system calls (linux/firewire-cdev.h).
//
// The kernel's read() waits whatever O_NONBLOCK says: poll the descriptor before each Read. A
// descriptor has at most one isochronous context.
// GET_CYCLE_TIMER is not used: on some machines it makes them start anew (AMD Ryzen with a VIA
// controller behind a bridge).
//
// Threads: one. Not real-time: system calls, no allocation after the constructor.
// Ownership: the destructor closes it; the kernel then stops its context and gives its channel
// back. Errors: BusError.
class FwNode {
 public:
  explicit FwNode(const std::string& path);
  ~FwNode();
  FwNode(const FwNode&) = delete;
  FwNode& operator=(const FwNode&) = delete;

  int descriptor() const { return descriptor_; }

  // Returns the bus's generation. From now on there are events of bus resets.
  std::uint32_t GetInfo();
  // Sends a request; its response is an event with its number. Data are in the order of the bus.
  struct Request {
    std::uint64_t number = 0;
    std::uint64_t address = 0;
    std::uint32_t generation = 0;
  };
  void AskToRead(const Request& request, std::size_t bytes);
  void AskToWrite(const Request& request, std::span<const std::uint8_t> data);
  // Asks for one of the channels (bit n: channel n) and bandwidth for packets of this size at 100
  // Mbit/s; the answer is an event. The kernel asks again after bus resets.
  void AskForChannel(std::uint64_t channels, std::size_t packet_bytes);

  void CreateReceiver(int channel);
  void CreateSender(int channel);
  // `controls`: a word for each of the packets, for a sender followed by its payload.
  void Queue(std::span<const std::uint32_t> controls, int packets);
  void Start();
  void Stop() noexcept;

  // Reads the event that waits. Returns its size; 0: there was none.
  std::size_t Read(std::span<std::uint8_t> event);

 private:
  int Call(unsigned long request, void* argument, const char* what);
  void Ask(const Request& request, std::uint32_t tcode, std::size_t bytes, const void* data);
  void Create(std::uint32_t type, std::uint32_t header_bytes, int channel);

  int descriptor_ = -1;
  std::uint32_t context_ = 0;
};

}  // namespace palpate
