// All that the servo thread is told: the volume, where it lies, the isovalue and
// the settings, as one immutable value behind one pointer.
//
// One value rather than two (a scene and a box of settings): no tick can mix a
// new volume with an old isovalue, or a new isovalue with an old stiffness, and
// one revision names all of it.
//
// Ownership: the session publishes scenes through a SnapshotHandoff, which frees
// them when the servo has moved on. The servo never touches the shared_ptr.
#pragma once

#include <cstdint>
#include <memory>

#include "server/haptics/haptic_surface.h"
#include "server/haptics/settings.h"
#include "server/realtime/snapshot_handoff.h"

namespace palpate {

struct Scene {
  std::shared_ptr<const VolumeSnapshot> volume;
  HapticSurface surface;  // borrows *volume
  double isovalue = 0.0;  // data units
  HapticSettings settings;
  std::uint64_t settings_revision = 0;
  std::uint64_t scene_revision = 0;  // of all of this
  bool forces_off = false;           // nothing is felt; the proxy starts anew afterwards
};

// The servo thread's way in.
using SceneInbox = SnapshotHandoff<Scene>;

}  // namespace palpate
