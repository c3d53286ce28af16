#include "tests/support/firewire_testbed.h"

#include <list>
#include <stdexcept>

#include "tests/support/firewire_card.h"
#include "tests/support/umockdev_bus.h"

namespace palpate::test {
namespace {

constexpr std::uint64_t kHostGuid = 0x00110600'00004a2b;

std::string Hex(std::uint64_t number, int digits) {
  std::string text = "0x";
  for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4) {
    text += "0123456789abcdef"[number >> shift & 15];
  }
  return text;
}

// In umockdev's own format. Each device has a unit, which has no node and no GUID.
std::string Description(const std::string& path, const std::string& node, std::uint64_t guid,
                        bool is_local) {
  const std::string unit = path + path.substr(path.rfind('/')) + ".0";
  const std::string vendor = "A: vendor=" + Hex(guid >> 40, 6) + "\\n\nA: model=0x000000\\n\n";
  return "P: " + path + "\nE: SUBSYSTEM=firewire\nE: DEVNAME=" + node +
         "\nA: guid=" + Hex(guid, 16) + "\\n\nA: is_local=" + (is_local ? "1" : "0") + "\\n\n" +
         vendor + "\nP: " + unit + "\nE: SUBSYSTEM=firewire\n" + vendor +
         "A: rom_index=9\\n\nA: specifier_id=0x00a02d\\n\n";
}

}  // namespace

struct FirewireTestbed::Impl {
  struct Plugged {
    std::string path{};
    FirewireNode* node = nullptr;
  };

  std::string Plug(EmulatedFirewireDevice& device, bool may_open, bool is_local) {
    const std::string name = "fw" + std::to_string(next_number++);
    const std::string node = "/dev/" + name;
    const std::string path = "/devices/pci0000:00/0000:00:05.0/" + name;
    auto made = std::make_unique<FirewireNode>(card, device, bus.root() + node, is_local);
    FirewireNode& there = *made;
    there.SetMayOpen(may_open);
    card.Add(std::move(made));
    bus.Attach(node, there);
    bus.Add(Description(path, node, device.guid(), is_local));
    plugged.push_back({.path = path, .node = &there});
    return node;
  }
  Plugged& Find(const EmulatedFirewireDevice& device) {
    for (Plugged& one : plugged) {
      if (&one.node->device() == &device) return one;
    }
    throw std::logic_error("it is not plugged in");
  }

  EmulatedFirewireDevice host{kHostGuid};
  int next_number = 0;
  std::mutex mutex{};  // of `plugged`
  std::list<Plugged> plugged{};
  FirewireCard card{};
  UmockdevBus bus{};  // ends before its nodes
};

FirewireTestbed::FirewireTestbed() : impl_(std::make_unique<Impl>()) {
  impl_->Plug(impl_->host, true, true);
}

FirewireTestbed::~FirewireTestbed() = default;

std::string FirewireTestbed::Plug(EmulatedFirewireDevice& device, bool may_open) {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->Plug(device, may_open, false);
}

void FirewireTestbed::SetMayOpen(EmulatedFirewireDevice& device, bool may_open) {
  const std::scoped_lock lock(impl_->mutex);
  impl_->Find(device).node->SetMayOpen(may_open);
}

void FirewireTestbed::Unplug(EmulatedFirewireDevice& device) {
  const std::scoped_lock lock(impl_->mutex);
  const Impl::Plugged one = impl_->Find(device);
  impl_->plugged.remove_if([&](const Impl::Plugged& other) { return other.node == one.node; });
  impl_->card.Remove(*one.node);
  impl_->bus.Remove(one.path + one.path.substr(one.path.rfind('/')) + ".0");
  impl_->bus.Remove(one.path);
}

void FirewireTestbed::BusReset() { impl_->card.BusReset(); }

void FirewireTestbed::SetFaults(const FirewireFaults& faults) { impl_->card.SetFaults(faults); }

std::vector<std::string> FirewireTestbed::wrapper() const { return impl_->bus.wrapper(); }

}  // namespace palpate::test
