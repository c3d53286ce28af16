#include "server/device/usb/libusb_handles.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

namespace palpate {
namespace {

constexpr char kUsbFolder[] = "/dev/bus/usb";

// The kernel's name of the device in /sys/bus/usb/devices.
std::string PortOf(libusb_device* device) {
  std::array<std::uint8_t, 7> ports{};  // USB allows no deeper tree
  const int depth = libusb_get_port_numbers(device, ports.data(), static_cast<int>(ports.size()));
  std::string name = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < depth; ++i) {
    name += (i == 0 ? '-' : '.') + std::to_string(ports[static_cast<std::size_t>(i)]);
  }
  return name;
}

bool MayOpen(libusb_device* device) {
  std::array<char, 64> node{};
  std::snprintf(node.data(), node.size(), "%s/%03d/%03d", kUsbFolder, libusb_get_bus_number(device),
                libusb_get_device_address(device));
  return access(node.data(), R_OK | W_OK) == 0;
}

}  // namespace

LibusbPtr<libusb_context> OpenLibusb() {
  libusb_context* context = nullptr;
  const int error = libusb_init(&context);
  if (error == LIBUSB_SUCCESS) return LibusbPtr<libusb_context>(context);
  if (access(kUsbFolder, X_OK) != 0) {
    throw BusError(BusFault::kAbsent, std::string("not found: this system has no USB (no ") +
                                          kUsbFolder + "); in a container, pass it in");
  }
  throw ErrorOf(error, "starting libusb");
}

std::vector<PluggedDevice> PluggedDevices(libusb_context* context,
                                          const std::vector<UsbMatch::Ids>& ids) {
  libusb_device** list = nullptr;
  const ssize_t count = libusb_get_device_list(context, &list);
  if (count < 0) throw ErrorOf(static_cast<int>(count), "listing USB devices");
  std::vector<PluggedDevice> plugged;
  for (ssize_t i = 0; i < count; ++i) {
    LibusbPtr<libusb_device> device(list[i]);
    libusb_device_descriptor descriptor{};
    if (libusb_get_device_descriptor(device.get(), &descriptor) != LIBUSB_SUCCESS) continue;
    const UsbMatch::Ids its{.vendor = descriptor.idVendor, .product = descriptor.idProduct};
    if (std::find(ids.begin(), ids.end(), its) == ids.end()) continue;
    const UsbFound found{
        .ids = its, .port = PortOf(device.get()), .may_open = MayOpen(device.get())};
    plugged.push_back({.device = std::move(device), .found = found});
  }
  libusb_free_device_list(list, 0);
  std::sort(plugged.begin(), plugged.end(), [](const PluggedDevice& a, const PluggedDevice& b) {
    return a.found.port < b.found.port;
  });
  return plugged;
}

BusError ErrorOf(int libusb_error, const std::string& what) {
  const auto error = [&](BusFault fault, const std::string& reason) {
    return BusError(fault, what + ": " + reason);
  };
  switch (libusb_error) {
    case LIBUSB_ERROR_NO_DEVICE:
    case LIBUSB_ERROR_NOT_FOUND:
      return error(BusFault::kAbsent, "the device is gone: plug it in again");
    case LIBUSB_ERROR_ACCESS:
      return error(BusFault::kPermission, std::string(kPermissionHint));
    case LIBUSB_ERROR_BUSY:
      return error(
          BusFault::kBusy,
          "another program uses the device: end it (another palpated, the vendor's tools)");
    case LIBUSB_ERROR_PIPE:
      return error(BusFault::kStall, "the device refused");
    case LIBUSB_ERROR_TIMEOUT:
      return error(BusFault::kTimeout, "no answer in time");
    default:
      return error(BusFault::kBroken,
                   std::string(libusb_error_name(libusb_error)) +
                       ": unplug the device and plug it in again, into another port if it stays");
  }
}

std::vector<UsbFound> FindUsbDevices(const std::vector<UsbMatch::Ids>& ids) {
  std::vector<UsbFound> all;
  try {
    const LibusbPtr<libusb_context> context = OpenLibusb();
    for (const PluggedDevice& plugged : PluggedDevices(context.get(), ids)) {
      all.push_back(plugged.found);
    }
  } catch (const BusError& error) {
    if (error.fault() != BusFault::kAbsent) throw;
  }
  return all;
}

}  // namespace palpate
