// The devices that the daemon can drive: made by their configuration names, and listed.
//
// Threads: MakeDevice on main; ListDevices on any ordinary thread.
#pragma once

#include <memory>
#include <vector>

#include "server/app/device_config.h"
#include "server/device/haptic_device.h"
#include "server/device/listed_device.h"

namespace palpate {

// Throws Error for an unknown kind, and for options that do not fit it.
std::unique_ptr<HapticDevice> MakeDevice(const DeviceConfig& config, int realtime_priority);

// Those of the configuration's kind and all others that this machine has. Opens none.
std::vector<ListedDevice> ListDevices(const DeviceConfig& config);

// Those that stop forces when they are held together. Throws Error for buttons that the
// device has not.
std::uint32_t StopButtons(const DeviceConfig& config, const DeviceSpec& spec);

}  // namespace palpate
