// A real palpated with emulated USB devices, and functions that tests use on both.
//
// Declare emulated devices before the rig: the rig's bus must be destroyed first.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <thread>

#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {

// `[device]` lines for the emulated Touch. The gains are arbitrary, because no real ones are
// public.
inline const std::string kTouchConfig =
    "kind = \"omni-usb\"\nframes = \"framed-firewire\"\n"
    "state_command = 0x21\nforce_command = 0x22\n"
    "init_payload = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, "
    "0, "
    "0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, "
    "0, "
    "0]\n"
    "motor_counts_per_n_mm = [4.0, 4.0, 4.0]\n";

inline bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// The stylus moves from the place of rest to below the sphere within kApproachS. Then it moves up
// into the sphere and back in kPressS, again and again. The sphere's radius is 22 mm, and the
// stylus goes 5 mm deep. At most 0.2 m/s.
inline constexpr double kApproachS = 0.4, kPressS = 0.5;
inline Vec3 PressFromBelow(double time_s) {
  const Vec3 rest_mm(0.0, -110.0, -35.0), below_mm(0.0, -36.0, 0.0);
  if (time_s < kApproachS) return rest_mm + time_s / kApproachS * (below_mm - rest_mm);
  const double depth_mm = 9.5 * (1.0 - std::cos(2.0 * M_PI * (time_s - kApproachS) / kPressS));
  return below_mm + Vec3(0.0, depth_mm, 0.0);
}

class DeviceRig {
 public:
  static constexpr auto kStreaming = v1::DEVICE_CONNECTION_STREAMING;
  static constexpr auto kAbsent = v1::DEVICE_CONNECTION_ABSENT;

  DeviceRig() = default;
  ~DeviceRig() {
    if (daemon_) End();
  }
  DeviceRig(const DeviceRig&) = delete;
  DeviceRig& operator=(const DeviceRig&) = delete;

  UsbTestbed& bus() { return bus_; }
  Daemon& daemon() { return *daemon_; }

  // device: lines for `[device]` of the configuration. The socket and state folder are those of the
  // previous daemon.
  void Start(const std::string& device, bool bound_by_modes = false) {
    const std::filesystem::path file = folder_.path() / "device.toml";
    std::ofstream(file) << "[device]\n" << device;
    daemon_ = std::make_unique<Daemon>(
        test::kPalpated,
        std::vector<std::string>{"--volume", "builtin:sphere:32", "--config", file.string(),
                                 "--socket", folder_.path() / "palpated.sock", "--state-folder",
                                 folder_.path() / "state"},
        bus_.wrapper(bound_by_modes));
  }

  v1::GetDeviceResponse Get() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    const grpc::Status status = daemon_->device->GetDevice(&context, {}, &response);
    if (!status.ok()) throw std::runtime_error(status.error_message());
    return response;
  }
  v1::DeviceHealth Health() { return Get().health(); }
  v1::ForceStatus Forces() { return Get().forces(); }

  grpc::Status Enable(const std::string& name) {
    grpc::ClientContext context;
    v1::EnableForcesRequest request;
    request.set_device(name);
    v1::EnableForcesResponse response;
    return daemon_->device->EnableForces(&context, request, &response);
  }
  grpc::Status Disable() {
    grpc::ClientContext context;
    v1::DisableForcesResponse response;
    return daemon_->device->DisableForces(&context, {}, &response);
  }
  grpc::Status StopForces() {
    grpc::ClientContext context;
    v1::StopForcesResponse response;
    return daemon_->device->StopForces(&context, {}, &response);
  }

  grpc::Status SetStiffness(double stiffness_n_per_mm) {
    grpc::ClientContext context;
    v1::UpdateSettingsRequest request;
    request.mutable_settings()->set_stiffness_n_per_mm(stiffness_n_per_mm);
    request.mutable_update_mask()->add_paths("stiffness_n_per_mm");
    v1::UpdateSettingsResponse response;
    return daemon_->render->UpdateSettings(&context, request, &response);
  }
  double Stiffness() {
    grpc::ClientContext context;
    v1::GetSettingsResponse response;
    EXPECT_TRUE(daemon_->render->GetSettings(&context, {}, &response).ok());
    return response.settings().stiffness_n_per_mm();
  }
  // True if the daemon has stored the line for its successor after a kill.
  bool IsKept(const std::string& line) const {
    for (const auto& file :
         std::filesystem::directory_iterator(folder_.path() / "state" / "sessions")) {
      if (file.path().extension() != ".toml") continue;  // a file that is still being written
      std::ostringstream text;
      text << std::ifstream(file.path()).rdbuf();
      if (Contains(text.str(), line)) return true;
    }
    return false;
  }

  bool WaitForConnection(v1::DeviceConnection connection) {
    return Eventually([&] { return Health().connection() == connection; });
  }
  bool WaitForForces(v1::ForceState state) {
    return Eventually([&] { return Forces().state() == state; });
  }
  // True if forces are on or ramp up: not held, and without a fault.
  bool WaitForAnyForce() {
    v1::ForceState state{};
    Eventually([&] { return (state = Forces().state()) != v1::FORCE_STATE_HELD; });
    return state == v1::FORCE_STATE_ON || state == v1::FORCE_STATE_RAMP_IN;
  }
  // Enables forces and waits until they are on or ramp up. On a busy machine, stale readings and
  // missed ticks hold the forces again and again, before the half second of the ramp is over.
  // Returns false if a fault ends the forces: if the machine stops for 100 ms, the device looks
  // silent.
  bool EnableAndWait(const std::string& device) {
    grpc::Status enabled;
    // Refused until the previous fault has passed.
    if (!Eventually([&] { return (enabled = Enable(device)).ok(); })) {
      std::printf("not enabled: %s\n", enabled.error_message().c_str());
      return false;
    }
    if (WaitForAnyForce()) return true;
    const v1::ForceStatus forces = Forces();
    std::printf("not on: %s, %s\n", v1::ForceState_Name(forces.state()).c_str(),
                v1::ForceReason_Name(forces.reason()).c_str());
    return false;
  }
  // Returns the mark of an excusable failure if the bus stood still: the device then looks silent.
  const char* ExcuseSince(std::int64_t time_ns) const {
    return bus_.HaltedSince(time_ns) ? kBusyMachine : "";
  }
  bool WaitForLog(const std::string& text) { return daemon_->process().WaitFor(text); }
  // Kills the daemon, like a crash.
  void Kill() {
    EXPECT_NE(daemon_->End(SIGKILL).exit_code, 0);
    daemon_.reset();
  }
  // Ends the daemon in order. Returns the daemon's log.
  std::string End() {
    const ProcessResult result = daemon_->End();
    daemon_.reset();
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return result.error;
  }

 private:
  TemporaryFolder folder_;
  UsbTestbed bus_;
  std::unique_ptr<Daemon> daemon_;
};

// Puts the stylus into its holder.
inline void Dock(TouchEmulator& touch) {
  touch.SetPath([](double) { return Vec3(0.0, -110.0, -35.0); });
  touch.SetDocked(true);
}

// Takes the stylus out of its holder; it then presses into the sphere.
inline void Undock(TouchEmulator& touch) {
  touch.SetDocked(false);
  touch.SetPath(PressFromBelow);
}

// Plugs a docked Touch into port 1-2 and starts a daemon that reads it.
inline bool StartDocked(DeviceRig& rig, TouchEmulator& touch) {
  Dock(touch);
  rig.bus().Plug("1-2", touch);
  rig.Start(kTouchConfig);
  return rig.WaitForConnection(DeviceRig::kStreaming) &&
         Eventually([&] { return rig.Health().calibrated(); });
}

inline std::size_t CountForces(const TouchEmulator& touch) {
  std::size_t count = 0;
  for (const TouchForce& force : touch.Forces()) {
    if (!force.IsZero()) ++count;
  }
  return count;
}

// At most one force comes per millisecond. So when this many forces have come, the stylus has moved
// at least that far on its path.
constexpr std::size_t kForcesOfAnApproach = 450, kForcesOfAPress = 600;

// Waits until this many more forces have come, zero or not, however slow the bus is.
inline bool TakesForces(const TouchEmulator& touch, std::size_t more) {
  const std::size_t before = touch.Forces().size();
  return Eventually([&] { return touch.Forces().size() >= before + more; });
}

// Returns false if a fault ends the forces: the machine stopped for long.
inline bool WaitForForce(DeviceRig& rig, const TouchEmulator& touch) {
  const std::size_t before = CountForces(touch);
  const auto is_fault = [&] { return rig.Forces().state() == v1::FORCE_STATE_FAULT; };
  return Eventually([&] { return CountForces(touch) > before + 20 || is_fault(); }) && !is_fault();
}

// The most tries that do not count because the emulated bus stood still meanwhile: a device that is
// silent for 100 ms ends the forces. If there are more such tries, the failure is excusable.
constexpr int kMostHaltedTries = 20;

// Repeats `attempt` until it succeeds. A failure counts only if the bus ran during the try.
template <typename Attempt>
testing::AssertionResult WhereTheBusRuns(const DeviceRig& rig, const Attempt& attempt) {
  for (int tries = 1;; ++tries) {
    const std::int64_t began_ns = NowNs();
    if (attempt()) return testing::AssertionSuccess();
    const std::string excuse = rig.ExcuseSince(began_ns);
    if (excuse.empty() || tries == kMostHaltedTries) {
      return testing::AssertionFailure() << "no forces" << excuse;
    }
  }
}

// Takes the stylus from the holder to a press, with forces on.
inline testing::AssertionResult PressWithForces(DeviceRig& rig, TouchEmulator& touch) {
  return WhereTheBusRuns(rig, [&] {
    Dock(touch);
    if (!rig.WaitForConnection(DeviceRig::kStreaming) ||
        !Eventually([&] { return rig.Health().calibrated(); })) {
      return false;
    }
    Undock(touch);
    return TakesForces(touch, kForcesOfAnApproach) && rig.EnableAndWait("omni-usb") &&
           WaitForForce(rig, touch);
  });
}

}  // namespace palpate::test
