// The instrument: the device, the servo loop, the pump that carries the loop's samples, and what
// watches over the forces.
//
// Threads: main.
// Errors: Error.
#pragma once

#include <filesystem>
#include <memory>

#include "server/app/config.h"
#include "server/app/device_monitor.h"
#include "server/app/devices.h"
#include "server/pump/pump.h"
#include "server/pump/tick_outbox.h"
#include "server/recording/black_box.h"
#include "server/servo/servo_loop.h"
#include "server/stop/stop_door.h"

namespace palpate {

class Instrument {
 public:
  Instrument(const Config& config, const std::filesystem::path& state_folder);
  ~Instrument();

  // Call it when a session has published its first scene.
  void Start();

  HandInboxes hand;
  const std::unique_ptr<HapticDevice> device;
  SceneInbox inbox;
  const std::unique_ptr<TickOutbox> outbox;
  Pump pump;
  const ForceWatch forces;
  const SafetyLimits limits;
  ServoLoop servo;
  StopDoor stop_door;  // the server opens it

 private:
  const std::shared_ptr<DeviceMonitor> monitor_;
  const std::shared_ptr<BlackBox> black_box_;
};

}  // namespace palpate
