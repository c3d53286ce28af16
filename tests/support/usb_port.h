// A plugged device as usbfs sees it: its node, its claimed interfaces, and its running transfers
// (URBs). A part of UsbTestbed.
//
// Threads: HandleIoctl on umockdev's thread, Millisecond on the bus's, Pull on the test's. All run
// under the device's mutex.
#pragma once

#include <list>
#include <set>
#include <string>

#include "tests/support/umockdev_bus.h"
#include "tests/support/usb_emulator.h"

struct usbdevfs_urb;

namespace palpate::test {

class UsbPort final : public UmockdevNode {
 public:
  // `node`: path of the pipe that replaces the device's node.
  UsbPort(EmulatedUsbDevice& device, const std::string& node, bool may_open);
  ~UsbPort() override;
  UsbPort(const UsbPort&) = delete;
  UsbPort& operator=(const UsbPort&) = delete;

  void Closed(UMockdevIoctlClient* client) override;
  void HandleIoctl(UMockdevIoctlClient* client) override;
  void Millisecond() override;
  // Removes the device: later calls find none.
  void Pull();

 private:
  struct Urb {
    UMockdevIoctlClient* client = nullptr;  // compared only
    UMockdevIoctlData* data = nullptr;      // owned: the usbdevfs_urb
    UMockdevIoctlData* buffer = nullptr;    // owned; may be null
    usbdevfs_urb& fields() const;
    std::span<std::uint8_t> bytes() const;
  };

  // Returns 0 or an error number.
  int Answer(UMockdevIoctlClient* client);
  int Submit(UMockdevIoctlClient* client);
  void LogLateOut(UMockdevIoctlClient* client);
  int Reap(UMockdevIoctlClient* client);
  int Discard(UMockdevIoctlClient* client);
  int Claim(std::uint8_t number);
  int BindDriver(std::uint8_t number, bool bind);
  int TellDriver(UMockdevIoctlClient* client);

  // Ends all transfers that can end.
  void Progress();
  // Returns false if the transfer must go on.
  bool TryEnd(Urb& urb);
  void EndControl(Urb& urb);
  bool TryEndIn(Urb& urb);
  void Finish(Urb& urb, int status, std::size_t actual_bytes);
  // Wakes the host if a transfer can be reaped.
  void SetNode();
  void Drop(std::list<Urb>& urbs, UMockdevIoctlClient* client);

  EmulatedUsbDevice& device_;
  const std::string node_;
  int pipe_ = -1;
  bool pipe_full_ = false;
  bool gone_ = false;
  std::vector<std::string> drivers_;  // the kernel's, by interface
  std::set<std::uint8_t> claimed_;
  std::set<UMockdevIoctlClient*> clients_;  // compared only
  std::list<Urb> under_way_, ended_;
};

}  // namespace palpate::test
