#include "tests/support/firewire_emulator.h"

#include <utility>

namespace palpate::test {

void EmulatedFirewireDevice::AnswerNext(int requests, std::uint32_t rcode,
                                        std::optional<std::uint64_t> address) {
  const std::scoped_lock lock(mutex_);
  faulty_requests_ = requests;
  fault_ = rcode;
  faulty_address_ = address;
}

std::vector<FirewireEvent> EmulatedFirewireDevice::Events() const {
  const std::scoped_lock lock(mutex_);
  return events_;
}

FirewireCounts EmulatedFirewireDevice::Counts() const {
  const std::scoped_lock lock(mutex_);
  return counts_;
}

std::map<std::string, int> EmulatedFirewireDevice::Mistakes() const {
  const std::scoped_lock lock(mutex_);
  return mistakes_;
}

std::uint32_t EmulatedFirewireDevice::Request(int descriptor, bool write, std::uint64_t address,
                                              bool block, std::span<std::uint8_t> data) {
  std::uint32_t rcode = RCODE_COMPLETE;
  if (faulty_requests_ > 0 && faulty_address_.value_or(address) == address) {
    --faulty_requests_;
    rcode = fault_;
  } else {
    rcode = write ? OnWrite(address, block, data) : OnRead(address, block, data);
  }
  Log({.kind = write ? FirewireEvent::Kind::kWrite : FirewireEvent::Kind::kRead,
       .descriptor = descriptor,
       .number = static_cast<std::int64_t>(address),
       .bytes = {data.begin(), data.end()},
       .rcode = rcode});
  return rcode;
}

void EmulatedFirewireDevice::Log(FirewireEvent event) {
  event.time_ns = NowNs();
  events_.push_back(std::move(event));
}

}  // namespace palpate::test
