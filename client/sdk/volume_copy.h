// What a mirror's thread hands to the thread that draws: all that changed since it was
// taken last, merged.
//
// Threads: Merge on the mirror's, Take on any. Errors: none.
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
  // Takes up what changed in the mirror. False where nothing did.
  bool Merge(VolumeMirror& mirror);
  std::optional<VolumeUpdate> Take();

 private:
  void Begin(const VolumeMirror& mirror);
  void Mark(std::uint64_t number);

  std::mutex mutex_;
  bool is_new_ = false;
  VolumeUpdate update_;           // but for the bricks
  std::vector<BrickPtr> bricks_;  // of the mirror
  std::vector<bool> is_marked_;   // by number: in marked_
  std::vector<std::uint64_t> marked_;
  bool has_overview_ = false;  // of this volume, taken or in update_
};

}  // namespace palpate::client
