// A bus without hardware, by umockdev: what the testbeds of USB and of FireWire share. It has the
// folders of /sys and /dev that a child process sees, and the devices' nodes.
//
// Threads: nodes may be attached on any thread. umockdev's own thread calls a node's Handle...()
// and Closed(), and the bus's thread calls Millisecond(). Ownership: nodes must outlive the bus.
#pragma once

#include <umockdev.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <list>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/emulated.h"

namespace palpate::test {

// For a node that may not be opened: a mode does not stop root. Nobody, not even root, may write
// this file.
inline constexpr const char* kForbidden = "/proc/sys/kernel/osrelease";

// What answers for a node of /dev.
class UmockdevNode {
 public:
  virtual ~UmockdevNode() = default;

  // Answers the ioctl.
  virtual void HandleIoctl(UMockdevIoctlClient* client) = 0;
  // Answers the read. False: the read goes to the file that stands for the node.
  virtual bool HandleRead(UMockdevIoctlClient*) { return false; }
  // Also for clients that could not open the node.
  virtual void Closed(UMockdevIoctlClient* client) = 0;
  virtual void Millisecond() = 0;
};

class UmockdevBus {
 public:
  UmockdevBus();
  ~UmockdevBus();
  UmockdevBus(const UmockdevBus&) = delete;
  UmockdevBus& operator=(const UmockdevBus&) = delete;

  // The folder that stands for /. Its dev/ exists.
  const std::string& root() const { return root_; }
  // Returns what to put before a command.
  std::vector<std::string> wrapper() const;

  // The node's ioctls go to `answers` from now on. `node`: "/dev/...".
  void Attach(const std::string& node, UmockdevNode& answers);
  // Adds devices, in umockdev's own format.
  void Add(const std::string& description);
  // Removes the device. `path`: "/devices/...".
  void Remove(const std::string& path);

 private:
  struct Attached {
    std::string node{};
    UmockdevNode* answers = nullptr;
    UMockdevIoctlBase* handler = nullptr;
  };
  void RunMilliseconds();

  const int clients_before_;
  UMockdevTestbed* testbed_ = nullptr;
  std::string root_;
  std::mutex mutex_;  // of attached_
  std::list<Attached> attached_;
  std::atomic<bool> stop_ = false;
  std::thread milliseconds_;
};

// The client's memory behind the ioctl's argument; owned by the caller.
inline UMockdevIoctlData* Argument(UMockdevIoctlClient* client, std::size_t bytes) {
  return umockdev_ioctl_data_resolve(umockdev_ioctl_client_get_arg(client), 0, bytes, nullptr);
}

template <class T>
T ArgumentValue(UMockdevIoctlClient* client) {
  T value{};
  if (UMockdevIoctlData* data = Argument(client, sizeof(T))) {
    std::memcpy(&value, data->data, sizeof(T));
    umockdev_ioctl_data_unref(data);
  }
  return value;
}

template <class T>
void SetArgument(UMockdevIoctlClient* client, const T& value) {
  if (UMockdevIoctlData* data = Argument(client, sizeof(T))) {
    std::memcpy(data->data, &value, sizeof(T));
    umockdev_ioctl_data_unref(data);
  }
}

// Copies all of `bytes` from, or to, the place that the pointer at `offset` names. Returns false if
// there is none.
inline bool CopyFrom(UMockdevIoctlData* data, std::size_t offset, Bytes& bytes) {
  UMockdevIoctlData* there = umockdev_ioctl_data_resolve(data, offset, bytes.size(), nullptr);
  if (!there) return false;
  std::copy_n(there->data, bytes.size(), bytes.begin());
  umockdev_ioctl_data_unref(there);
  return true;
}
inline void CopyTo(UMockdevIoctlData* data, std::size_t offset, const Bytes& bytes) {
  UMockdevIoctlData* there = umockdev_ioctl_data_resolve(data, offset, bytes.size(), nullptr);
  if (!there) return;
  std::copy(bytes.begin(), bytes.end(), there->data);
  umockdev_ioctl_data_unref(there);
}

}  // namespace palpate::test
