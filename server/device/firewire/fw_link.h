// A FireWire device: its registers, two channels, and a stream of packets each way.
//
// It uses two descriptors of the device's node, because each has at most one context: one for
// registers, channels and received packets, one for sent packets. Packets come within the events
// (fw_node.h), so no memory is shared with the kernel.
//
// At most kMostUnderWay sent packets wait in the kernel. One leaves in each cycle of 125 us, so a
// force that is sent now leaves within three cycles.
//
// Threads: only the I/O thread that opened it. Not real-time.
// Ownership: the destructor ends the stream; the kernel gives the channels back.
// Errors: BusError.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/device/firewire/fw_node.h"

namespace palpate {

class FwLink {
 public:
  static constexpr std::size_t kSentBytes = 16;      // of each sent packet
  static constexpr std::size_t kReceiveSlots = 512;  // 64 ms of packets at 8 kHz
  static constexpr int kMostUnderWay = 3;
  // Answers such as "busy" are asked again for this long.
  static constexpr std::chrono::milliseconds kAskTime{2000};
  // The kernel waits for a second after a bus reset before it allocates.
  static constexpr std::chrono::milliseconds kChannelTime{3000};
  // If no packet leaves for this long, the device keeps an old force, so the stream ends.
  static constexpr std::chrono::milliseconds kSendTime{100};

  explicit FwLink(const std::string& node) : receiver_(node), sender_(node) {
    generation_ = receiver_.GetInfo();
    sender_.GetInfo();
  }

  // Begins to write a register, of which answer tells. For one request at a time, and while a
  // stream may not stand still.
  enum class Answer : std::uint8_t { kNone, kDone, kAgain };  // kAgain: it is to be asked again
  void BeginWrite(std::uint64_t address, std::span<const std::uint8_t> data);
  // Throws if the device refuses.
  Answer answer() const;

  // Waits for the answer; gives up soon after `stop` becomes true. One at a time. Packets that come
  // meanwhile go to the stream's receiver.
  std::vector<std::uint8_t> Read(std::uint64_t address, std::size_t bytes,
                                 const std::atomic<bool>& stop,
                                 std::chrono::milliseconds longest = kAskTime);
  void Write(std::uint64_t address, std::span<const std::uint8_t> data,
             const std::atomic<bool>& stop, std::chrono::milliseconds longest = kAskTime);
  // Returns one of the channels (bit n: channel n); none: none is free.
  std::optional<int> AllocateChannel(std::uint64_t channels, std::size_t packet_bytes,
                                     const std::atomic<bool>& stop);

  // From now on packets come and can be sent. `first`: sent at once.
  using Receiver = std::function<void(const FwPacket&)>;
  void StartStream(int receive_channel, int send_channel, Receiver receive,
                   std::span<const std::uint8_t, kSentBytes> first);
  // The kernel tells of each so manieth packet.
  void SetPacketsPerEvent(int packets) { packets_per_event_ = packets; }
  // Ends both contexts. The kernel stops them anyway when the link is closed.
  void StopStream() noexcept;
  // Handles what is due, for at most this long.
  void Wait(std::chrono::microseconds longest);
  // Returns false if too many packets are under way.
  bool TrySend(std::span<const std::uint8_t, kSentBytes> packet);
  // No packet has left for kSendTime, though some are under way.
  bool is_stuck() const;
  // The bus has taken a channel back after a reset.
  bool has_lost_a_channel() const { return has_lost_a_channel_; }
  bool has_sent_all() const { return under_way_ == 0; }
  // True once after each bus reset.
  bool TakeBusReset() { return std::exchange(bus_was_reset_, false); }
  // The number of requests that were tried again.
  std::uint64_t retries() const { return retries_; }

 private:
  using Clock = std::chrono::steady_clock;

  template <class Ask>
  std::vector<std::uint8_t> Transact(Ask ask, const char* what, const std::atomic<bool>& stop,
                                     std::chrono::milliseconds longest);
  bool WaitUntil(const std::function<bool()>& is_so, Clock::time_point end,
                 const std::atomic<bool>& stop);
  FwNode::Request NextRequest(std::uint64_t address);
  bool Poll(std::chrono::microseconds longest);
  void Take(FwNode& node);
  void TakePackets(std::span<const std::uint8_t> headers);
  void QueueSlots(std::size_t count);

  FwNode receiver_;
  FwNode sender_;
  std::uint32_t generation_ = 0;
  bool bus_was_reset_ = false;
  std::uint64_t request_ = 0;           // number of the newest request
  Clock::time_point asked_{};           // its time
  std::optional<std::uint32_t> rcode_;  // of its response
  std::vector<std::uint8_t> data_;      // of its response
  std::optional<int> channel_;          // of the newest allocation
  bool has_lost_a_channel_ = false;
  Receiver receive_;
  int packets_per_event_ = 1;
  std::size_t slots_queued_ = 0;
  int under_way_ = 0;
  int events_behind_ = 0;  // since this thread last had to wait for one
  Clock::time_point newest_sent_{};
  std::uint64_t retries_ = 0;
  std::array<std::uint8_t, kFwEventBytes> event_{};
};

}  // namespace palpate
