// UsbLink without USB. A test links direct_usb_link.cpp instead of palpate::usb, and its links go
// straight to an emulated device, whose milliseconds pass when a link receives.
//
// Threads: one. Not for streams: StartStream and the functions for streams do nothing.
#pragma once

#include "tests/support/usb_emulator.h"

namespace palpate::test {

// All UsbLinks made from now on lead to this device, on port 1-2.
void SetDirectUsb(EmulatedUsbDevice& device);

}  // namespace palpate::test
