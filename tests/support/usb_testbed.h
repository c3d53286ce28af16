// A USB bus without hardware, by umockdev: a child process started with wrapper() in
// front of its command sees the plugged devices through an unmodified libusb, and no
// others. The kernel needs no USB, and the tests no rights.
//
// umockdev's preloaded library sends the child's usbfs ioctls here; transfers end as
// the EmulatedUsbDevice says. The device's node is a pipe of one page: full while
// nothing is to be reaped, so that libusb's poll for writing waits as on real usbfs.
// Isochronous transfers are refused.
//
// Threads: any one; umockdev's own and the bus's millisecond thread run beside it.
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

  // `port` as in /sys/bus/usb/devices, on bus 1: "1-2". may_open: the node's modes let
  // its owner in (which does not stop root; see wrapper).
  void Plug(const std::string& port, EmulatedUsbDevice& device, bool may_open = true);
  // Pulls it out: transfers under way end, later calls find no device.
  void Unplug(const std::string& port);

  // Whether the bus stood still for 50 ms after that time (NowNs()), or its threads waited as long
  // for a processor within 100 ms: a busy machine, which makes any device look silent.
  bool HaltedSince(std::int64_t time_ns) const;

  // What to put before a command. bound_by_modes: also takes root's right to open any
  // file away.
  std::vector<std::string> wrapper(bool bound_by_modes = false) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::test
