// Selects the device that the daemon drives, and holds the options of each device.
//
// Threads: main, at start.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "server/device/forcedimension/forcedimension_bus.h"
#include "server/device/haply/haply_bus.h"

namespace palpate {

struct DeviceConfig {
  std::string kind = "simulated";  // see MakeDevice()
  int pressed_buttons = 0;         // for the simulated device, see PressScript
  double torque_n_mm = 0.0;        // for the simulated device: its greatest
  std::string serial;              // "": the only device
  // Buttons that stop the forces while all of them are held. Absent: both buttons of hardware, and
  // no buttons of a simulated device.
  std::optional<std::uint32_t> stop_buttons;
  std::string replay_file;      // for `replay`: a recording
  std::string usb_port;         // for example "1-2"; "": the only device
  std::string falcon_firmware;  // for `falcon`: a file
  // For `omni-firewire`, see OmniArm. Absent: its motors stay off.
  std::optional<std::array<double, 3>> motor_counts_per_n_mm;
  std::string openhaptics_library;       // for `openhaptics`; "": the system searches for libHD.so
  std::string openhaptics_name;          // as in the vendor's set-up; "": the vendor's default
  ForceDimensionOptions forcedimension;  // without its serial number
  HaplyOptions haply;                    // without its serial number
};

}  // namespace palpate
