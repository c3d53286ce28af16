// Collects all changes of a mirror, merged, until the thread that draws takes them.
//
// Threads: Merge on the mirror's thread, Take on any. Errors: none.
#pragma once

#include <cstddef>
#include <mutex>
#include <optional>

#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_update.h"

namespace palpate::client {

class VolumeCopy {
 public:
  // Collects the mirror's changes. Returns false if nothing changed.
  bool Merge(VolumeMirror& mirror);
  std::optional<VolumeUpdate> Take();

 private:
  void Begin(const VolumeMirror& mirror);

  std::mutex mutex_;
  bool is_new_ = false;
  VolumeUpdate update_;        // without `bricks`; its `changed` may overlap
  BrickMap bricks_;            // shares its blocks with what was taken
  std::size_t joined_ = 0;     // runs in update_.changed after they were joined last
  bool has_overview_ = false;  // the overview of this volume was taken, or is in update_
};

}  // namespace palpate::client
