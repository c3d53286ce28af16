// Makes devices by their configuration names, and lists the devices that the daemon can drive.
//
// Threads: MakeDevice on main; ListDevices and what DeviceListOf returns on any ordinary thread.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "server/app/config.h"
#include "server/device/haptic_device.h"
#include "server/simulated_hand/led_hand.h"
#include "server/simulated_hand/touch_planner.h"

namespace palpate {

// What leads the hand of the simulated device, which borrows both.
struct HandInboxes {
  TouchPlanInbox plans;  // without a plan, the hand explores by touch alone
  LedHand led;
};

// Throws Error for an unknown kind, or for options that do not fit the kind.
std::unique_ptr<HapticDevice> MakeDevice(const DeviceConfig& config, int realtime_priority,
                                         HandInboxes& hand);

// Returns the configured device and all other devices of this machine. Opens none of them.
std::vector<ListedDevice> ListDevices(const DeviceConfig& config);

// Returns a ListDevices that looks at most once a second and else repeats its answer: a look loads
// the vendor's library and searches the USB, beside the servo. Borrows `config`.
std::function<std::vector<ListedDevice>()> DeviceListOf(const DeviceConfig& config);

// Returns the buttons that stop the forces while all of them are held. Throws Error if the device
// lacks one of the buttons.
std::uint32_t StopButtons(const DeviceConfig& config, const DeviceDescription& spec);

}  // namespace palpate
