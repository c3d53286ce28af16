// A FireWire bus without hardware, by umockdev: a card (fw0) and what is plugged into it. A child
// process is started with wrapper() in front of its command; a test may also use /dev/fw* and
// /sys/bus/firewire itself, if umockdev's preload library is linked before the C library.
//
// Where the machine is busy the bus may stand still, and then every device looks silent: a test
// waits until the device is there again. The machine's time is made up for 10 ms only; the stamps
// count the bus's own cycles.
//
// Threads: any one. umockdev's own thread and the bus's millisecond thread run beside it.
// Ownership: plugged devices must outlive the testbed.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tests/support/firewire_emulator.h"

namespace palpate::test {

class FirewireTestbed {
 public:
  FirewireTestbed();
  ~FirewireTestbed();

  // The device gets the next node: /dev/fw1, /dev/fw2, ... Others on the bus see a bus reset.
  // Returns the node. may_open: opening it succeeds; if not, then not for root either.
  std::string Plug(EmulatedFirewireDevice& device, bool may_open = true);
  void SetMayOpen(EmulatedFirewireDevice& device, bool may_open);
  // Pulls the device out: later calls find no device, where the kernel waits 2 s for it to come
  // back. Others on the bus see a bus reset.
  void Unplug(EmulatedFirewireDevice& device);
  // The kernel waits 1 s before it allocates anew.
  void BusReset();
  void SetFaults(const FirewireFaults& faults);

  // Returns what to put before a command.
  std::vector<std::string> wrapper() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::test
