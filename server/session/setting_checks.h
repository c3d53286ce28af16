// Checks of what clients ask for, before the session changes: numbers, the tool, layers.
//
// Threads: pure functions. Errors: Error.
#pragma once

#include <fmt/core.h>

#include <string>
#include <string_view>

#include "common/contract/device.h"
#include "common/contract/enumerations.h"
#include "common/contract/render.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "server/haptics/settings.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// One wording for all numbers out of range.
class RangeError : public Error {
 public:
  RangeError(std::string_view name, const std::string& message)
      : Error(ErrorKind::kInvalidArgument, message), name_(name) {}
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

// `unit`: with a leading blank, or empty. Also refuses NaN.
inline void CheckRange(std::string_view name, double value, double low, double high,
                       std::string_view unit) {
  if (value >= low && value <= high) return;
  throw RangeError(name, fmt::format("{} {} is not within {} to {}{}", name, value, NumberText(low),
                                     NumberText(high), unit));
}

// Throws Error (kInvalidArgument) for what no tool can be: too many balls or radii, numbers out of
// range.
void CheckTool(const HeldTool& tool);

// Which other settings forbid a tool, for people; empty: none, or there is no tool.
std::string RefusalWithTool(const HapticSettings& haptics);

// Throws Error (kFailedPrecondition) if there is a tool, and other settings or the device forbid
// it.
void CheckHeld(const HapticSettings& haptics, const DeviceDescription& device);

// Sorts them by isovalue, and gives an id to those that have none (0): that of the layer of `felt`
// with the same name, or one that no layer has. Throws Error (kInvalidArgument) for what no layers
// can be: too many, ids or names twice, numbers out of range.
void OrderLayers(const SurfaceLayers& felt, SurfaceLayers& layers);

// Throws Error (kInvalidArgument) if there are layers and they would be felt from above.
void CheckSide(const SurfaceLayers& layers, FreeSide side);

// For layers in order: throws Error (kInvalidArgument) for isovalues out of the volume's range, and
// for two that are too close.
void CheckLayers(const SurfaceLayers& layers, const VolumeMetadata& volume);

// Removes all layers if their isovalues mean something else on the new volume: it is in other units,
// or without units another one. Returns a line for people; empty: they stay.
std::string RemoveLayersOf(const VolumeMetadata& before, const VolumeMetadata& volume,
                           SurfaceLayers& layers);

// Leaves out the layers that the volume cannot have when it is felt from this side. Returns a line
// for people; empty: all fit.
std::string FitLayers(const VolumeMetadata& volume, FreeSide side, SurfaceLayers& layers);

}  // namespace palpate
