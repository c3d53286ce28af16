#include "tests/support/usb_testbed.h"

#include <sched.h>
#include <sys/stat.h>
#include <time.h>
#include <umockdev.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <list>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "tests/support/usb_port.h"

namespace palpate::test {
namespace {

constexpr const char* kPreload = "libumockdev-preload.so.0";
constexpr std::int64_t kMillisecondNs = 1'000'000;

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

gboolean OnIoctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer port) {
  static_cast<UsbPort*>(port)->HandleIoctl(client);
  return TRUE;
}

// Threads that are started meanwhile, also umockdev's, are real-time ones where the kernel grants
// it: a real bus waits for no other program. Below the threads of palpated.
class RealtimeStart {
 public:
  RealtimeStart() {
    sched_getparam(0, &before_);
    policy_ = sched_getscheduler(0);
    const sched_param bus{.sched_priority = 20};
    sched_setscheduler(0, SCHED_FIFO, &bus);
  }
  ~RealtimeStart() { sched_setscheduler(0, policy_, &before_); }
  RealtimeStart(const RealtimeStart&) = delete;
  RealtimeStart& operator=(const RealtimeStart&) = delete;

 private:
  int policy_ = SCHED_OTHER;
  sched_param before_{};
};

// Of all testbeds; those of failed opens too.
std::atomic<int> g_clients = 0;

void OnClosed(gpointer port, GObject* client) {
  static_cast<UsbPort*>(port)->Closed(reinterpret_cast<UMockdevIoctlClient*>(client));
  --g_clients;
}

// umockdev 0.17 has a signal for clients that go, and never sends it.
void OnConnected(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer port) {
  ++g_clients;
  g_object_weak_ref(G_OBJECT(client), OnClosed, port);
}

}  // namespace

struct UsbTestbed::Impl {
  struct Plugged {
    std::string port{}, path{}, node{};
    UMockdevIoctlBase* handler = nullptr;
    std::unique_ptr<UsbPort> usb{};
    bool gone = false;
  };

  void Add(const std::string& description) {
    GError* error = nullptr;
    if (!umockdev_testbed_add_from_string(testbed, description.c_str(), &error)) {
      const std::string message = error->message;
      g_error_free(error);
      throw std::runtime_error("umockdev: " + message);
    }
  }

  void RunMilliseconds() {
    std::int64_t due_ns = NowNs();
    while (!stop) {
      due_ns = std::max(due_ns + kMillisecondNs, NowNs() - 10 * kMillisecondNs);
      const timespec due{due_ns / 1'000'000'000, due_ns % 1'000'000'000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr);
      const std::scoped_lock lock(mutex);
      for (Plugged& one : plugged) {
        if (!one.gone) one.usb->Millisecond();
      }
    }
  }

  UMockdevTestbed* testbed = nullptr;
  std::string root{};
  int next_number = 2;
  std::mutex mutex{};  // of `plugged`
  std::list<Plugged> plugged{};
  std::atomic<bool> stop = false;
  std::thread milliseconds{};
};

UsbTestbed::UsbTestbed() : impl_(std::make_unique<Impl>()) {
  const RealtimeStart realtime;
  impl_->testbed = umockdev_testbed_new();
  gchar* root = umockdev_testbed_get_root_dir(impl_->testbed);
  impl_->root = root;
  g_free(root);
  chmod(impl_->root.c_str(), 0755);
  std::filesystem::create_directories(impl_->root + "/dev/bus/usb/001");
  // libusb names a device's port by its hub.
  impl_->Add(Description(
      "/devices/usb1", 1,
      {.vendor = 0x1d6b,
       .product = 0x0002,
       .device_class = 9,
       .interfaces = {{.device_class = 9, .endpoints = {{.address = 0x81, .type = 3}}}}}));
  impl_->milliseconds = std::thread([this] { impl_->RunMilliseconds(); });
}

UsbTestbed::~UsbTestbed() {
  impl_->stop = true;
  impl_->milliseconds.join();
  // umockdev is noisy about clients that it has not yet seen go.
  for (int n = 0; n < 200 && g_clients > 0; ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  for (Impl::Plugged& one : impl_->plugged) {
    umockdev_testbed_detach_ioctl(impl_->testbed, one.node.c_str(), nullptr);
    g_object_unref(one.handler);
  }
  g_object_unref(impl_->testbed);
}

void UsbTestbed::Plug(const std::string& port, EmulatedUsbDevice& device, bool may_open) {
  const RealtimeStart realtime;
  const int number = impl_->next_number++;
  Impl::Plugged one;
  one.port = port;
  one.node = NodeOf(number);
  one.path = "/devices/usb1/" + port;
  one.usb = std::make_unique<UsbPort>(device, impl_->root + one.node, may_open);
  one.handler = umockdev_ioctl_base_new();
  g_signal_connect(one.handler, "handle-ioctl", G_CALLBACK(OnIoctl), one.usb.get());
  g_signal_connect(one.handler, "client-connected", G_CALLBACK(OnConnected), one.usb.get());
  if (!umockdev_testbed_attach_ioctl(impl_->testbed, one.node.c_str(), one.handler, nullptr)) {
    throw std::runtime_error("umockdev: cannot answer for " + one.node);
  }
  impl_->Add(Description(one.path, number, device.spec()));
  const std::scoped_lock lock(impl_->mutex);
  impl_->plugged.push_back(std::move(one));
}

void UsbTestbed::Unplug(const std::string& port) {
  const std::scoped_lock lock(impl_->mutex);
  for (Impl::Plugged& one : impl_->plugged) {
    if (one.gone || one.port != port) continue;
    one.gone = true;
    one.usb->Pull();
    umockdev_testbed_remove_device(impl_->testbed, ("/sys" + one.path).c_str());
    return;
  }
  throw std::logic_error("nothing is plugged into " + port);
}

std::vector<std::string> UsbTestbed::wrapper() const {
  // The heap is the C library's: umockdev and jemalloc call each other at the start.
  return {"/usr/bin/env",
          std::string("LD_PRELOAD=").append(kPreload).append(":libc.so.6:libstdc++.so.6"),
          "UMOCKDEV_DIR=" + impl_->root};
}

}  // namespace palpate::test
