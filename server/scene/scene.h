// The servo thread's input: the volume, its placement, the isovalue and the settings, as one
// immutable value behind one pointer.
//
// It is one value, so no tick can mix a new volume with an old isovalue, or a new isovalue with an
// old stiffness. One revision names all of it.
//
// Ownership: the session publishes scenes through a SnapshotHandoff, which frees them when the
// servo and the pump have moved on. The servo never touches the shared_ptr.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "server/haptics/haptic_surface.h"
#include "server/haptics/settings.h"
#include "server/realtime/snapshot_handoff.h"

namespace palpate {

struct Scene {
  std::shared_ptr<const VolumeSnapshot> volume;
  std::shared_ptr<const HapticLayers> layers;  // null: the one surface
  HapticSurface surface;                       // borrows *volume and *layers
  double isovalue = 0.0;                       // data units
  HapticSettings settings;
  std::uint64_t settings_revision = 0;
  std::uint64_t scene_revision = 0;  // of the whole scene
  std::string patient_axes;          // of the file or answered, as in VolumeMetadata; for listeners
  bool forces_off = false;           // nothing is felt; afterwards the proxy starts anew
  std::optional<double> series_position_frames{};  // as SeriesState; none: no series
};

// Through this inbox the servo thread gets its scenes.
using SceneInbox = SnapshotHandoff<Scene>;

}  // namespace palpate
