// Collects all changes of a mirror, merged, until the thread that draws takes them.
//
// Threads: Merge on the mirror's thread, Take on any. Errors: none.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

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
  void Mark(std::uint64_t number);

  std::mutex mutex_;
  bool is_new_ = false;
  VolumeUpdate update_;           // without the bricks
  std::vector<BrickPtr> bricks_;  // the mirror's
  std::vector<bool> is_marked_;   // by brick number: listed in marked_
  std::vector<std::uint64_t> marked_;
  bool has_overview_ = false;  // the overview of this volume was taken, or is in update_
};

}  // namespace palpate::client
