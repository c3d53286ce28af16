// The volume of each scene of a recording, from the volume that was loaded and the
// recorded edits.
//
// Where the recording does not lead to a scene's volume (voxels are missing, or the
// source is another one now), it says so, keeps the last volume that it had, and goes
// on where a scene fits that or the edits lead on from it. All is decided by hashes.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/recording/recording.h"
#include "server/volume/snapshot.h"

namespace palpate {

// A scene's volume as it was loaded, before any edit; where scene.all_voxels_stored, any of
// its size, spacing and range. May throw Error.
using RecordedVolumeLoader =
    std::function<std::shared_ptr<const VolumeSnapshot>(const RecordedScene&)>;

class VolumeFollower {
 public:
  explicit VolumeFollower(RecordedVolumeLoader load) : load_(std::move(load)) {}

  // Part of the next scene's volume.
  void Take(RecordedEdit edit) { edits_.push_back(std::move(edit)); }

  // Null, with error(), where the recording does not lead to it.
  std::shared_ptr<const VolumeSnapshot> Follow(const RecordedScene& scene);

  // Why the last scene has no volume.
  const std::optional<Error>& error() const { return error_; }
  std::uint64_t applied_edits() const { return applied_edits_; }  // several parts are one

 private:
  std::shared_ptr<const VolumeSnapshot> TryFollow(const RecordedScene& scene,
                                                  const std::vector<RecordedEdit>& edits);

  RecordedVolumeLoader load_;
  std::vector<RecordedEdit> edits_;
  std::shared_ptr<const VolumeSnapshot> volume_;
  std::optional<std::uint64_t> loaded_revision_;  // tried
  std::uint64_t base_revision_ = 0;               // that edits of volume_ name
  std::uint64_t applied_edits_ = 0;
  std::optional<Error> error_;
};

// Of the size, spacing and range of a scene's volume, for edits that hold all its voxels. Throws
// Error (kInvalidArgument) for a volume that no recording holds.
std::shared_ptr<const VolumeSnapshot> WithoutVoxels(const RecordedScene& scene);

// `volume` with these parts of one edit. Throws Error (kInvalidArgument) for bricks
// that it does not have, and voxels that are no numbers.
std::shared_ptr<const VolumeSnapshot> WithEdits(const VolumeSnapshot& volume,
                                                const std::vector<RecordedEdit>& edits);

}  // namespace palpate
