// The servo thread's input: the volume, its placement, the isovalue and the settings, as one
// immutable value behind one pointer.
//
// It is one value, so no tick can mix a new volume with an old isovalue, or a new isovalue with an
// old stiffness. One revision names all of it.
//
// Ownership: the session publishes scenes through a SnapshotHandoff, which frees them when the
// servo and the pump have moved on. The servo never touches the shared_ptr.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/contract/render.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/cell_cache.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/settings.h"
#include "server/haptics/tool/tool_renderer.h"
#include "server/realtime/snapshot_handoff.h"
#include "server/volume/snapshot/ball.h"

namespace palpate {

// The settings of a scene that clients may change.
//
// Threads: a plain value.
struct RenderSettings {
  double isovalue = 0.0;             // data units
  double normalized_isovalue = 0.5;  // the same isovalue over the volume's range, 0 to 1
  HapticSettings haptics{};
};

// The ball that is felt at the tip.
struct SceneBall {
  std::shared_ptr<const VolumeSnapshot> field;  // in place of the volume
  Ball ball;                                    // that the field was made for
  double radius_mm = 0.0;                       // where the volume lies now
  AffineMap X_DI;                               // of the volume; the surface's is the field's
};

// One for each radius of a tool. Scenes share them: they hold no state. The servo thread's alone.
using ToolCaches = std::array<std::unique_ptr<ToolCellCache>, kMostToolRadii>;

// The rigid tool that is felt.
struct SceneTool {
  HeldTool held;             // as the settings have it
  std::vector<Ball> fields;  // that its fields were made for: of each radius above 0
  std::array<std::shared_ptr<const VolumeSnapshot>, kMostToolRadii> volume;  // of each radius
  std::shared_ptr<ToolCaches> caches;
  FeltTool felt;  // borrows the volumes and the caches
};

struct Scene {
  std::shared_ptr<const VolumeSnapshot> volume;
  std::shared_ptr<const SceneTool> tool;       // null: none
  std::optional<SceneBall> ball;               // none: a point, or a tool
  std::shared_ptr<const HapticLayers> layers;  // null: the one surface
  HapticSurface surface;                       // borrows *layers, and *ball->field or else *volume;
                                               // with a tool, the tip's
  double isovalue = 0.0;                       // data units
  HapticSettings settings;
  std::uint64_t settings_revision = 0;
  std::uint64_t scene_revision = 0;  // of the whole scene
  std::string patient_axes;          // of the file or answered, as in VolumeMetadata; for listeners
  bool forces_off = false;           // nothing is felt; afterwards the proxy starts anew
  std::optional<double> series_position_frames{};  // as SeriesState; none: no series

  const AffineMap& X_DI() const { return ball ? ball->X_DI : surface.X_DI; }
  const std::shared_ptr<const VolumeSnapshot>& felt_volume() const {
    return ball ? ball->field : volume;
  }
};

// Through this inbox the servo thread gets its scenes.
using SceneInbox = SnapshotHandoff<Scene>;

}  // namespace palpate
