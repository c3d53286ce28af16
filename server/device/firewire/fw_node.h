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
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "server/device/stream/bus_error.h"

namespace palpate {

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
