// A USB bus without hardware, by umockdev. A child process is started with wrapper() in front of
// its command. It sees only the plugged devices, through an unmodified libusb. The kernel needs no
// USB, and the tests need no rights.
//
// Where the machine is busy the bus may stand still, and then every device looks silent: a test
// waits until the device is there again.
//
// umockdev's preloaded library sends the child's usbfs ioctls here. Transfers end as the
// EmulatedUsbDevice says. The device's node is a pipe of one page. It is full while there is
// nothing to reap, so that libusb's poll for writing waits as on real usbfs. Isochronous transfers
// are refused.
//
// Threads: any one. umockdev's own thread and the bus's millisecond thread run beside it.
// Ownership: plugged devices must outlive the testbed.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tests/support/usb_emulator.h"

namespace palpate::test {

class UsbTestbed {
 public:
  UsbTestbed();
  ~UsbTestbed();

  // `port`: as in /sys/bus/usb/devices, on bus 1: "1-2". may_open: opening it succeeds; if
  // not, then not for root either.
  void Plug(const std::string& port, EmulatedUsbDevice& device, bool may_open = true);
  // Pulls the device out: running transfers end, later calls find no device.
  void Unplug(const std::string& port);

  // Returns what to put before a command.
  std::vector<std::string> wrapper() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::test
