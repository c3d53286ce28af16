// The scenes of a recording: their settings, and the volume of each.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"
#include "server/felt/scene.h"
#include "server/recording/recording.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// Converts scenes of the servo to recorded scenes and back.

// `hash`: the hash of the scene's volume. `safety`, `device`: the servo's.
RecordedScene ToRecorded(const Scene& scene, const VolumeHash& hash, double tick_period_s,
                         const SafetyLimits& safety, const PassivityDevice& device);

// Returns a scene in which a tick gives the recorded bits. `hash`: the hash of `volume`.
// Throws Error: kConflict if `volume` is not the recorded volume, or if the scene has settings that
// this program does not know.
// `tip`: of the scene before, empty at first; goes on to this scene's.
Scene ToScene(const RecordedScene& recorded, std::shared_ptr<const VolumeSnapshot> volume,
              const VolumeHash& hash, FeltTip& tip);

// Returns a scene's volume as it was loaded, before any edit. If scene.all_voxels_stored, any
// volume of the scene's size, spacing and range will do. May throw Error.
using RecordedVolumeLoader =
    std::function<std::shared_ptr<const VolumeSnapshot>(const RecordedScene&)>;

// Rebuilds the volume of each scene of a recording from the loaded volume and the recorded edits.
//
// A scene's volume cannot be rebuilt if voxels are missing, or if the source holds another volume
// now. Follow then returns null, error() holds the reason, and the object keeps the last volume.
// Follow succeeds again at the first scene whose volume equals the kept volume, or whose edits
// lead on from the kept volume. The object compares volumes by their hashes. It
// keeps the frames of a series, which may come again (kMostFrameBricks).
//
// Threads: one at a time. Not for real-time code.
class RecordedVolumes {
 public:
  explicit RecordedVolumes(RecordedVolumeLoader load) : load_(std::move(load)) {}

  // Takes an edit, or a part of one, that leads to the next scene's volume.
  void Take(RecordedEdit edit) { edits_.push_back(std::move(edit)); }

  // Returns the scene's volume; null, and sets error(), if it cannot be rebuilt.
  std::shared_ptr<const VolumeSnapshot> Follow(const RecordedScene& scene);

  // Why the last Follow returned null; none if it succeeded.
  const std::optional<Error>& error() const { return error_; }
  std::uint64_t applied_edits() const { return applied_edits_; }  // the parts of an edit count once

 private:
  std::shared_ptr<const VolumeSnapshot> TryFollow(const RecordedScene& scene,
                                                  std::vector<RecordedEdit> edits);
  // Puts the bricks of a frame that came before into the edit.
  void Recall(const RecordedScene& scene, RecordedEdit& edit) const;
  void Keep(const RecordedScene& scene, const std::vector<RecordedEdit>& edits);

  RecordedVolumeLoader load_;
  std::vector<RecordedEdit> edits_;
  std::shared_ptr<const VolumeSnapshot> volume_;
  std::optional<std::uint64_t> loaded_revision_;  // of the last load, also if it failed
  std::uint64_t base_revision_ = 0;               // base of the next edits of volume_
  std::map<VolumeHash, std::shared_ptr<const VolumeSnapshot>> frames_;
  std::uint64_t frame_bricks_ = 0;
  std::uint64_t applied_edits_ = 0;
  std::optional<Error> error_;
};

// Returns a volume of the scene's size, spacing and range, filled with background. Apply edits that
// hold all voxels to it. Throws Error (kInvalidArgument) if no recording can hold such a volume.
std::shared_ptr<const VolumeSnapshot> WithoutVoxels(const RecordedScene& scene);

// Returns `volume` with all parts of one edit applied. `edits` must not be empty. Throws Error
// (kInvalidArgument) if a brick is outside the volume or a voxel is not finite.
std::shared_ptr<const VolumeSnapshot> WithEdits(const VolumeSnapshot& volume,
                                                const std::vector<RecordedEdit>& edits);

}  // namespace palpate
