#include "tests/support/umockdev_bus.h"

#include <sched.h>
#include <sys/stat.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <stdexcept>

#include "tests/support/emulated.h"

namespace palpate::test {
namespace {

constexpr const char* kPreload = "libumockdev-preload.so.0";
constexpr std::int64_t kMillisecondNs = 1'000'000;

gboolean OnIoctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer node) {
  static_cast<UmockdevNode*>(node)->HandleIoctl(client);
  return TRUE;
}

gboolean OnRead(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer node) {
  return static_cast<UmockdevNode*>(node)->HandleRead(client) ? TRUE : FALSE;
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

// Of all buses; those of failed opens too. umockdev never closes these before the process ends.
std::atomic<int> g_clients = 0;

void OnClosed(gpointer node, GObject* client) {
  static_cast<UmockdevNode*>(node)->Closed(reinterpret_cast<UMockdevIoctlClient*>(client));
  --g_clients;
}

// umockdev 0.17 has a signal for clients that go, and never sends it.
void OnConnected(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer node) {
  ++g_clients;
  g_object_weak_ref(G_OBJECT(client), OnClosed, node);
}

}  // namespace

UmockdevBus::UmockdevBus() : clients_before_(g_clients) {
  const RealtimeStart realtime;
  testbed_ = umockdev_testbed_new();
  gchar* root = umockdev_testbed_get_root_dir(testbed_);
  root_ = root;
  g_free(root);
  chmod(root_.c_str(), 0755);
  mkdir((root_ + "/dev").c_str(), 0755);
  milliseconds_ = std::thread([this] { RunMilliseconds(); });
}

UmockdevBus::~UmockdevBus() {
  stop_ = true;
  milliseconds_.join();
  // umockdev is noisy about clients that it has not yet seen go.
  for (int n = 0; n < 200 && g_clients > clients_before_; ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  for (const Attached& one : attached_) {
    umockdev_testbed_detach_ioctl(testbed_, one.node.c_str(), nullptr);
    g_object_unref(one.handler);
  }
  g_object_unref(testbed_);
}

std::vector<std::string> UmockdevBus::wrapper() const {
  // The heap is the C library's: umockdev and jemalloc call each other at the start.
  return {"/usr/bin/env",
          std::string("LD_PRELOAD=").append(kPreload).append(":libc.so.6:libstdc++.so.6"),
          "UMOCKDEV_DIR=" + root_};
}

void UmockdevBus::Attach(const std::string& node, UmockdevNode& answers) {
  const RealtimeStart realtime;
  UMockdevIoctlBase* handler = umockdev_ioctl_base_new();
  g_signal_connect(handler, "handle-ioctl", G_CALLBACK(OnIoctl), &answers);
  g_signal_connect(handler, "handle-read", G_CALLBACK(OnRead), &answers);
  g_signal_connect(handler, "client-connected", G_CALLBACK(OnConnected), &answers);
  if (!umockdev_testbed_attach_ioctl(testbed_, node.c_str(), handler, nullptr)) {
    throw std::runtime_error("umockdev: cannot answer for " + node);
  }
  const std::scoped_lock lock(mutex_);
  attached_.push_back({.node = node, .answers = &answers, .handler = handler});
}

void UmockdevBus::Add(const std::string& description) {
  GError* error = nullptr;
  if (umockdev_testbed_add_from_string(testbed_, description.c_str(), &error)) return;
  const std::string message = error->message;
  g_error_free(error);
  throw std::runtime_error("umockdev: " + message);
}

void UmockdevBus::Remove(const std::string& path) {
  umockdev_testbed_remove_device(testbed_, ("/sys" + path).c_str());
}

void UmockdevBus::RunMilliseconds() {
  std::int64_t due_ns = NowNs();
  while (!stop_) {
    due_ns = std::max(due_ns + kMillisecondNs, NowNs() - 10 * kMillisecondNs);
    const timespec due{due_ns / 1'000'000'000, due_ns % 1'000'000'000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr);
    const std::scoped_lock lock(mutex_);
    for (const Attached& one : attached_) one.answers->Millisecond();
  }
}

}  // namespace palpate::test
