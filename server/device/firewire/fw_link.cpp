#include "server/device/firewire/fw_link.h"

#include <linux/firewire-cdev.h>
#include <linux/firewire-constants.h>
#include <poll.h>

#include <algorithm>
#include <cstring>
#include <utility>

namespace palpate {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

// The kernel itself gives a request up after 100 ms.
constexpr milliseconds kAnswerTime{250};
constexpr milliseconds kPause{20};
constexpr microseconds kLook{20'000};  // whether to stop

bool IsPassing(std::uint32_t rcode) {
  return rcode == RCODE_BUSY || rcode == RCODE_GENERATION || rcode == RCODE_CANCELLED ||
         rcode == RCODE_NO_ACK || rcode == RCODE_SEND_ERROR || rcode == RCODE_CONFLICT_ERROR;
}

}  // namespace

template <class Ask>
std::vector<std::uint8_t> FwLink::Transact(Ask ask, std::uint64_t address, const char* what,
                                           const std::atomic<bool>& stop, milliseconds longest) {
  const Clock::time_point end = Clock::now() + longest;
  for (;; ++retries_) {
    rcode_.reset();
    ask(FwNode::Request{++request_, address, generation_});
    const Clock::time_point now = Clock::now();
    const bool answered =
        WaitUntil([this] { return rcode_.has_value(); }, std::min(now + kAnswerTime, end), stop);
    if (answered && *rcode_ == RCODE_COMPLETE) return data_;
    const std::string of = answered ? ": it answers " + std::to_string(*rcode_) : "";
    if (answered && !IsPassing(*rcode_)) {
      throw BusError(BusFault::kUnsuitable, std::string(what) + " is refused" + of);
    }
    if (stop || Clock::now() + kPause >= end) {
      throw BusError(BusFault::kTimeout, "the device does not answer when " + std::string(what) +
                                             " is asked for" + of + "; check its power and cable");
    }
    WaitUntil([] { return false; }, Clock::now() + kPause, stop);
  }
}

std::vector<std::uint8_t> FwLink::Read(std::uint64_t address, std::size_t bytes,
                                       const std::atomic<bool>& stop, milliseconds longest) {
  std::vector<std::uint8_t> data =
      Transact([&](const FwNode::Request& request) { receiver_.AskToRead(request, bytes); },
               address, "reading a register", stop, longest);
  if (data.size() != bytes) {
    throw BusError(BusFault::kCorrupt, "a register has another size than it should");
  }
  return data;
}

void FwLink::Write(std::uint64_t address, std::span<const std::uint8_t> data,
                   const std::atomic<bool>& stop, milliseconds longest) {
  Transact([&](const FwNode::Request& request) { receiver_.AskToWrite(request, data); }, address,
           "writing a register", stop, longest);
}

std::optional<int> FwLink::AllocateChannel(std::uint64_t channels, std::size_t packet_bytes,
                                           const std::atomic<bool>& stop) {
  channel_.reset();
  receiver_.AskForChannel(channels, packet_bytes);
  if (!WaitUntil([this] { return channel_.has_value(); }, Clock::now() + kChannelTime, stop)) {
    throw BusError(BusFault::kTimeout, "the FireWire bus gives no channel: nobody manages it");
  }
  return *channel_ >= 0 ? channel_ : std::nullopt;
}

void FwLink::StartStream(int receive_channel, int send_channel, Receiver receive,
                         std::span<const std::uint8_t, kSentBytes> first) {
  receive_ = std::move(receive);
  receiver_.CreateReceiver(receive_channel);
  sender_.CreateSender(send_channel);
  streams_ = true;
  QueueSlots(kReceiveSlots);
  newest_sent_ = Clock::now();
  TrySend(first);  // the kernel starts no empty queue
  receiver_.Start();
  sender_.Start();
}

// Each slot holds one packet. It is named again after its packet has come.
void FwLink::QueueSlots(std::size_t count) {
  std::array<std::uint32_t, kReceiveSlots> controls{};
  count = std::min(count, controls.size());
  for (std::size_t n = 0; n < count; ++n) {
    const bool tells = ++slots_queued_ % static_cast<std::size_t>(packets_per_event_) == 0;
    controls[n] = FW_CDEV_ISO_HEADER_LENGTH(static_cast<std::uint32_t>(kFwPacketHeaderBytes)) |
                  (tells ? FW_CDEV_ISO_INTERRUPT : 0u);
  }
  receiver_.Queue(std::span(controls).first(count));
}

// Each sent packet tells its end: else the kernel never frees it.
bool FwLink::TrySend(std::span<const std::uint8_t, kSentBytes> packet) {
  if (under_way_ >= kMostUnderWay) {
    if (Clock::now() - newest_sent_ > kSendTime) {
      throw BusError(BusFault::kTimeout, "no force leaves the FireWire controller");
    }
    return false;
  }
  std::array<std::uint32_t, 1 + kSentBytes / 4> queued{
      FW_CDEV_ISO_HEADER_LENGTH(static_cast<std::uint32_t>(kSentBytes)) | FW_CDEV_ISO_INTERRUPT};
  std::memcpy(&queued[1], packet.data(), packet.size());
  sender_.Queue(queued);
  ++under_way_;
  newest_sent_ = Clock::now();
  return true;
}

void FwLink::Wait(microseconds longest) { Poll(longest); }

bool FwLink::WaitUntil(const std::function<bool()>& is_so, Clock::time_point end,
                       const std::atomic<bool>& stop) {
  while (!is_so()) {
    const auto left = std::chrono::duration_cast<microseconds>(end - Clock::now());
    if (stop || left <= microseconds(0)) return false;
    Poll(std::min(left, kLook));
  }
  return true;
}

void FwLink::Poll(microseconds longest) {
  std::array<pollfd, 2> polled{pollfd{receiver_.descriptor(), POLLIN, 0},
                               pollfd{sender_.descriptor(), POLLIN, 0}};
  constexpr std::int64_t kNsPerUs = 1000;
  const timespec time{.tv_sec = 0, .tv_nsec = longest.count() * kNsPerUs};
  if (ppoll(polled.data(), polled.size(), &time, nullptr) <= 0) return;
  if ((polled[0].revents & POLLIN) != 0) Take(receiver_);
  if ((polled[1].revents & POLLIN) != 0) Take(sender_);
  for (const pollfd& one : polled) {
    if ((one.revents & (POLLHUP | POLLERR)) != 0) throw BusError(BusFault::kAbsent, "unplugged");
  }
}

void FwLink::Take(FwNode& node) {
  const std::size_t bytes = node.Read(event_);
  const std::optional<FwEvent> event = ParseFwEvent(std::span(event_).first(bytes));
  if (!event) return;
  if (const auto* reset = std::get_if<FwBusReset>(&*event)) {
    if (&node != &receiver_) return;
    generation_ = reset->generation;
    bus_was_reset_ = true;
  } else if (const auto* response = std::get_if<FwResponse>(&*event)) {
    if (response->request != request_) return;  // one that was given up
    rcode_ = response->rcode;
    data_.assign(response->data.begin(), response->data.end());
  } else if (const auto* resource = std::get_if<FwResource>(&*event)) {
    if (!resource->allocated) {
      throw BusError(BusFault::kBroken, "the FireWire bus took a channel back after a bus reset");
    }
    channel_ = resource->channel;
  } else if (const auto* packets = std::get_if<FwPackets>(&*event)) {
    constexpr int kTimeBytes = 4;  // of each sent packet
    if (&node == &receiver_) {
      TakePackets(packets->headers);
    } else {
      under_way_ -= std::min(under_way_, static_cast<int>(packets->headers.size()) / kTimeBytes);
    }
  }
}

void FwLink::TakePackets(std::span<const std::uint8_t> headers) {
  std::size_t count = 0;
  while (const std::optional<FwPacket> packet = TakeFwPacket(headers)) {
    ++count;
    receive_(*packet);
  }
  if (count > 0) QueueSlots(count);
}

}  // namespace palpate
