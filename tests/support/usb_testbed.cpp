#include "tests/support/usb_testbed.h"

#include <filesystem>
#include <list>
#include <mutex>
#include <stdexcept>

#include "tests/support/umockdev_bus.h"
#include "tests/support/usb_port.h"

namespace palpate::test {
namespace {

std::string Hex(const Bytes& bytes) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

std::string Hex(std::uint16_t word) {
  return Hex(Bytes{static_cast<std::uint8_t>(word >> 8), static_cast<std::uint8_t>(word)});
}

std::string NodeOf(int number) {
  const std::string text = std::to_string(1000 + number).substr(1);
  return "/dev/bus/usb/001/" + text;
}

// In umockdev's own format.
std::string Description(const std::string& path, int number, const UsbSpec& spec) {
  const std::string no = std::to_string(number);
  return "P: " + path +
         "\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nE: DRIVER=usb\nE: BUSNUM=001\n" +
         "E: DEVNUM=" + NodeOf(number).substr(17) + "\nE: DEVNAME=" + NodeOf(number) +
         "\nA: busnum=1\\n\nA: devnum=" + no + "\\n\nA: bConfigurationValue=1\\n\n" +
         "A: bNumConfigurations=1\\n\nA: speed=480\\n\nA: idVendor=" + Hex(spec.vendor) +
         "\\n\nA: idProduct=" + Hex(spec.product) +
         "\\n\nH: descriptors=" + Hex(MakeUsbDescriptors(spec)) + "\n";
}

}  // namespace

struct UsbTestbed::Impl {
  struct Plugged {
    std::string port{}, path{};
    std::unique_ptr<UsbPort> usb{};
    bool gone = false;
  };

  int next_number = 2;
  std::mutex mutex{};  // of `plugged`
  std::list<Plugged> plugged{};
  UmockdevBus bus{};  // ends before its ports
};

UsbTestbed::UsbTestbed() : impl_(std::make_unique<Impl>()) {
  std::filesystem::create_directories(impl_->bus.root() + "/dev/bus/usb/001");
  // libusb names a device's port by its hub.
  impl_->bus.Add(Description(
      "/devices/usb1", 1,
      {.vendor = 0x1d6b,
       .product = 0x0002,
       .device_class = 9,
       .interfaces = {{.device_class = 9, .endpoints = {{.address = 0x81, .type = 3}}}}}));
}

UsbTestbed::~UsbTestbed() = default;

void UsbTestbed::Plug(const std::string& port, EmulatedUsbDevice& device, bool may_open) {
  const std::scoped_lock lock(impl_->mutex);
  const int number = impl_->next_number++;
  const std::string node = NodeOf(number);
  Impl::Plugged one{.port = port, .path = "/devices/usb1/" + port};
  one.usb = std::make_unique<UsbPort>(device, impl_->bus.root() + node, may_open);
  impl_->bus.Attach(node, *one.usb);
  impl_->bus.Add(Description(one.path, number, device.spec()));
  impl_->plugged.push_back(std::move(one));
}

void UsbTestbed::Unplug(const std::string& port) {
  const std::scoped_lock lock(impl_->mutex);
  for (Impl::Plugged& one : impl_->plugged) {
    if (one.gone || one.port != port) continue;
    one.gone = true;
    one.usb->Pull();
    impl_->bus.Remove(one.path);
    return;
  }
  throw std::logic_error("nothing is plugged into " + port);
}

std::vector<std::string> UsbTestbed::wrapper() const { return impl_->bus.wrapper(); }

}  // namespace palpate::test
