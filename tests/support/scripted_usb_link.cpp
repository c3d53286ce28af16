#include "tests/support/scripted_usb_link.h"

#include <algorithm>
#include <thread>

namespace palpate {
namespace {

test::ScriptedUsb* current = nullptr;

}  // namespace

void test::SetScriptedUsb(ScriptedUsb& script) { current = &script; }

struct UsbLink::Impl {
  test::ScriptedUsb& script;
};

UsbLink::UsbLink(const UsbMatch&) : impl_(new Impl{*current}) {}
UsbLink::~UsbLink() = default;

const UsbFound& UsbLink::found() const { return impl_->script.found; }

std::size_t UsbLink::Control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                             std::uint16_t index, std::span<std::uint8_t> data,
                             std::chrono::milliseconds) {
  test::ScriptedUsb& script = impl_->script;
  script.requests.push_back({request_type, request, value, index, {data.begin(), data.end()}});
  return script.control ? script.control(script.requests.back(), data) : data.size();
}

void UsbLink::Send(std::span<const std::uint8_t> bytes, std::chrono::milliseconds) {
  test::ScriptedUsb& script = impl_->script;
  script.sent.emplace_back(bytes.begin(), bytes.end());
  if (script.send) script.send(script.sent.back());
}

std::size_t UsbLink::Receive(std::span<std::uint8_t> bytes, std::chrono::milliseconds timeout) {
  auto& in = impl_->script.in;
  if (impl_->script.receive) {
    const std::vector<std::uint8_t> transfer = impl_->script.receive(bytes.size());
    if (transfer.empty()) throw UsbError(UsbFault::kTimeout, "no answer");
    std::copy(transfer.begin(), transfer.end(), bytes.begin());
    return transfer.size();
  }
  if (in.empty()) {
    std::this_thread::sleep_for(timeout);
    throw UsbError(UsbFault::kTimeout, "no answer");
  }
  const std::size_t count = std::min(bytes.size(), in.front().size());
  std::copy_n(in.front().begin(), count, bytes.begin());
  in.pop_front();
  return count;
}

void UsbLink::StartStream(std::size_t, Receiver, std::span<const std::uint8_t>) {}
void UsbLink::Wait(std::chrono::microseconds) {}
bool UsbLink::TrySend(std::span<const std::uint8_t>) { return true; }
void UsbLink::EndStream() noexcept {}
std::uint64_t UsbLink::transfer_errors() const { return 0; }

}  // namespace palpate
