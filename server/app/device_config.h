// Which device the daemon drives, and what that device must be told.
//
// Threads: main, at start.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace palpate {

struct DeviceConfig {
  std::string kind = "simulated";  // see MakeDevice()
  int pressed_buttons = 0;         // of the simulated device, see PressScript
  // Held together they stop the forces; none: both buttons of hardware, and none of a
  // simulated device.
  std::optional<std::uint32_t> stop_buttons;
  std::string replay_file;  // of `replay`: a recording
  std::string usb_port;     // "1-2"; "": the only one there is
  // Of `omni-usb`, see OmniUsbOptions.
  bool framed_firewire = false;
  std::optional<std::uint8_t> state_command;
  std::optional<std::uint8_t> force_command;
  std::vector<std::uint8_t> init_payload;  // empty: not given
  std::optional<std::array<double, 3>> motor_counts_per_n_mm;
  std::string falcon_firmware;      // of `falcon`: a file
  std::string openhaptics_library;  // of `openhaptics`; "": libHD.so, as the system finds it
  std::string openhaptics_name;     // as in the vendor's set-up; "": its default
};

}  // namespace palpate
