// A USB bus without hardware, by umockdev. A child process is started with wrapper() in front of
// its command. It sees only the plugged devices, through an unmodified libusb. The kernel needs no
// USB, and the tests need no rights.
//
// umockdev's preloaded library sends the child's usbfs ioctls here. Transfers end as the
// EmulatedUsbDevice says. The device's node is a pipe of one page. It is full while there is
// nothing to reap, so that libusb's poll for writing waits as on real usbfs. Isochronous transfers
// are refused.
//
// Threads: any one. umockdev's own thread and the bus's millisecond thread run beside it.
// Ownership: plugged devices must outlive the testbed.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/usb_emulator.h"

namespace palpate::test {

class UsbTestbed {
 public:
  UsbTestbed();
  ~UsbTestbed();

  // `port`: as in /sys/bus/usb/devices, on bus 1: "1-2". may_open: the node's mode lets its owner
  // open it (the mode does not stop root; see wrapper).
  void Plug(const std::string& port, EmulatedUsbDevice& device, bool may_open = true);
  // Pulls the device out: running transfers end, later calls find no device.
  void Unplug(const std::string& port);

  // True if the bus stood still for 50 ms after that time (NowNs()), or its threads waited 50 ms
  // for a processor within 100 ms. The machine is then busy, and any device looks silent.
  bool HaltedSince(std::int64_t time_ns) const;

  // Returns what to put before a command. bound_by_modes: also removes root's right to open any
  // file.
  std::vector<std::string> wrapper(bool bound_by_modes = false) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::test
