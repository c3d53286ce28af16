// For tests of ticks: a built-in volume around the origin of D, and a device that says what the
// test wants it to say.
#pragma once

#include <memory>

#include "server/device/haptic_device.h"
#include "server/felt/scene.h"
#include "server/haptics/haptic_surface.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate::testing {

// The most that the force of a simulated device changes in a tick.
inline constexpr double kMaxStepN = 0.2 + 1e-9;

struct PlacedVolume {
  std::shared_ptr<const VolumeSnapshot> volume;
  HapticSurface surface;  // at ½
};

// The middle of the volume is at the origin of D.
inline PlacedVolume PlaceBuiltin(const char* source, double mm_per_voxel) {
  const BuiltinVolume builtin = MakeBuiltin(source);
  PlacedVolume placed{MakeSnapshot(builtin.grid, builtin.metadata, 1), {}};
  const Vec3 middle = 0.5 * mm_per_voxel * (builtin.metadata.size.cast<double>() - Vec3::Ones());
  placed.surface = MakeHapticSurface(*placed.volume, {Mat3::Identity() * mm_per_voxel, -middle},
                                     0.5, DecompositionMethod::kTpbcc, 1);
  return placed;
}

// A sphere of radius 12 mm about the origin.
inline Scene SphereScene() {
  const PlacedVolume sphere = PlaceBuiltin("builtin:sphere:64", 0.5);
  Scene scene;
  scene.volume = sphere.volume;
  scene.surface = sphere.surface;
  scene.isovalue = 0.5;
  return scene;
}

class FakeDevice final : public HapticDevice {
 public:
  explicit FakeDevice(VerificationLevel level) {
    spec_.kind = "fake";
    spec_.max_force_n = 3.3;
    spec_.continuous_force_n = 0.88;
    spec_.max_torque_n_mm = 50.0;
    spec_.verification_level = level;
  }
  const DeviceDescription& spec() const override { return spec_; }
  void Start() override {}
  void Stop() noexcept override {}
  DeviceStatus Read(DeviceState& state) noexcept override {
    if (status != DeviceStatus::kFault) state = reading;
    return status;
  }
  void Write(const DeviceCommand& command, double) noexcept override { written = command; }

  DeviceState reading;
  DeviceStatus status = DeviceStatus::kOk;
  DeviceCommand written;

 private:
  DeviceDescription spec_;
};

}  // namespace palpate::testing
