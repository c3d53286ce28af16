// Owners for libusb's objects, a list of its devices by port name, and its errors as BusErrors.
// Private to this folder: code outside of it does not see libusb.
//
// Threads: as UsbLink.
#pragma once

#include <libusb.h>

#include <memory>
#include <string>
#include <vector>

#include "server/device/usb/usb_link.h"

namespace palpate {

struct LibusbDeleter {
  void operator()(libusb_context* context) const { libusb_exit(context); }
  void operator()(libusb_device* device) const { libusb_unref_device(device); }
  void operator()(libusb_device_handle* handle) const { libusb_close(handle); }
  void operator()(libusb_config_descriptor* c) const { libusb_free_config_descriptor(c); }
  void operator()(libusb_transfer* transfer) const { libusb_free_transfer(transfer); }
};
template <class T>
using LibusbPtr = std::unique_ptr<T, LibusbDeleter>;

// Throws kAbsent on a system without USB.
LibusbPtr<libusb_context> OpenLibusb();

struct PluggedDevice {
  LibusbPtr<libusb_device> device{};
  UsbFound found{};
};

// Returns the devices on all buses with one of the ids, in order of their ports.
std::vector<PluggedDevice> PluggedDevices(libusb_context* context,
                                          const std::vector<UsbMatch::Ids>& ids);

// Returns an error to throw. `what`: the failed action, for example "opening it".
BusError ErrorOf(int libusb_error, const std::string& what);

}  // namespace palpate
