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
constexpr int kMostBehind = 4;

bool IsPassing(std::uint32_t rcode) {
  return rcode == RCODE_BUSY || rcode == RCODE_GENERATION || rcode == RCODE_CANCELLED ||
         rcode == RCODE_NO_ACK || rcode == RCODE_SEND_ERROR || rcode == RCODE_CONFLICT_ERROR;
}

}  // namespace

FwNode::Request FwLink::NextRequest(std::uint64_t address) {
  rcode_.reset();
  asked_ = Clock::now();
  return {.number = ++request_, .address = address, .generation = generation_};
}

void FwLink::BeginWrite(std::uint64_t address, std::span<const std::uint8_t> data) {
  receiver_.AskToWrite(NextRequest(address), data);
}

FwLink::Answer FwLink::answer() const {
  if (!rcode_) return Clock::now() > asked_ + kAnswerTime ? Answer::kAgain : Answer::kNone;
  if (*rcode_ == RCODE_COMPLETE) return Answer::kDone;
  if (IsPassing(*rcode_)) return Answer::kAgain;
  throw BusError(BusFault::kUnsuitable,
                 "the device refuses a register, with answer " + std::to_string(*rcode_));
}

template <class Ask>
std::vector<std::uint8_t> FwLink::Transact(Ask ask, const char* what, const std::atomic<bool>& stop,
                                           milliseconds longest) {
  const Clock::time_point end = Clock::now() + longest;
  for (;; ++retries_) {
    ask();
    WaitUntil([this] { return answer() != Answer::kNone; }, end, stop);
    if (answer() == Answer::kDone) return data_;
    if (stop || Clock::now() + kPause >= end) {
      throw BusError(BusFault::kTimeout,
                     std::string("the device ") + (rcode_ ? "stays busy" : "does not answer") +
                         " when " + what + " is asked for; check its power and cable");
    }
    WaitUntil([] { return false; }, Clock::now() + kPause, stop);
  }
}

std::vector<std::uint8_t> FwLink::Read(std::uint64_t address, std::size_t bytes,
                                       const std::atomic<bool>& stop, milliseconds longest) {
  std::vector<std::uint8_t> data =
      Transact([&] { receiver_.AskToRead(NextRequest(address), bytes); }, "reading a register",
               stop, longest);
  if (data.size() != bytes) {
    throw BusError(BusFault::kCorrupt, "a register has another size than it should");
  }
  return data;
}

void FwLink::Write(std::uint64_t address, std::span<const std::uint8_t> data,
                   const std::atomic<bool>& stop, milliseconds longest) {
  Transact([&] { BeginWrite(address, data); }, "writing a register", stop, longest);
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
  receiver_.Queue(std::span(controls).first(count), static_cast<int>(count));
}

// Each sent packet tells its end: else the kernel never frees it.
bool FwLink::TrySend(std::span<const std::uint8_t, kSentBytes> packet) {
  if (under_way_ >= kMostUnderWay) return false;
  std::array<std::uint32_t, 1 + kSentBytes / 4> queued{
      FW_CDEV_ISO_HEADER_LENGTH(static_cast<std::uint32_t>(kSentBytes)) | FW_CDEV_ISO_INTERRUPT};
  std::memcpy(&queued[1], packet.data(), packet.size());
  sender_.Queue(queued, 1);
  ++under_way_;
  newest_sent_ = Clock::now();
  return true;
}

bool FwLink::is_stuck() const {
  return under_way_ >= kMostUnderWay && Clock::now() - newest_sent_ > kSendTime;
}

void FwLink::StopStream() noexcept {
  sender_.Stop();
  receiver_.Stop();
}

// Each reading is to be answered. After a pause of this thread many events wait: old readings must
// not pass for new ones.
void FwLink::Wait(microseconds longest) {
  if (!Poll(microseconds(0))) {
    events_behind_ = 0;
    Poll(longest);
  } else if (++events_behind_ > kMostBehind) {
    for (std::size_t n = 0; n < kReceiveSlots && Poll(microseconds(0)); ++n) {
    }
  }
}

bool FwLink::WaitUntil(const std::function<bool()>& is_so, Clock::time_point end,
                       const std::atomic<bool>& stop) {
  while (!is_so()) {
    const auto left = std::chrono::duration_cast<microseconds>(end - Clock::now());
    if (stop || left <= microseconds(0)) return false;
    Poll(std::min(left, kLook));
  }
  return true;
}

// Takes an event of each descriptor. Returns false if there was none.
bool FwLink::Poll(microseconds longest) {
  std::array<pollfd, 2> polled{pollfd{receiver_.descriptor(), POLLIN, 0},
                               pollfd{sender_.descriptor(), POLLIN, 0}};
  constexpr std::int64_t kNsPerUs = 1000;
  const timespec time{.tv_sec = 0, .tv_nsec = longest.count() * kNsPerUs};
  if (ppoll(polled.data(), polled.size(), &time, nullptr) <= 0) return false;
  if ((polled[0].revents & POLLIN) != 0) Take(receiver_);
  if ((polled[1].revents & POLLIN) != 0) Take(sender_);
  for (const pollfd& one : polled) {
    if ((one.revents & (POLLHUP | POLLERR)) != 0) throw BusError(BusFault::kAbsent, "unplugged");
  }
  return true;
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
    if (resource->allocated) {
      channel_ = resource->channel;
    } else {
      has_lost_a_channel_ = true;
    }
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
