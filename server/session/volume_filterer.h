// Filters of the session's volume in the background, each one step of the editor's history.
//
// A filter works on a snapshot, without a lock. Then, in the editor's turn, it looks at what was
// edited meanwhile. What that changes it computes again: at once where that is brief, else without
// the lock, in rounds. So its result is the filter of the volume that it replaces, to the bit.
// One of the whole volume (reshape.h) cannot follow edits: it begins again, and gives up where they
// go on.
//
// Threads: any ordinary thread; one filter at a time, others are refused. Ownership: borrows both.
// Errors: Error; nothing changes then.
#pragma once

#include <mutex>

#include "server/session/session.h"
#include "server/session/volume_editor.h"
#include "server/volume/filter.h"

namespace palpate {

class VolumeFilterer {
 public:
  VolumeFilterer(Session& session, VolumeEditor& editor) : session_(session), editor_(editor) {}

  // Publishes without waiting for the servo. `expected`: the volume revision at which it begins;
  // edits from then on are filtered too. `progress`: not while edits wait.
  // kInvalidArgument; kTooLarge: not within the memory budget; kCancelled; kConflict: another
  // filter runs, another revision than expected, another volume was loaded, or edits change more
  // than the filter can follow; of a whole volume also while one is loaded, or shown from a series.
  EditOutcome Filter(const VolumeFilter& filter, const VolumeEditor::Revision& expected,
                     const LoadProgress& progress, const LoadCancelled& cancelled);

 private:
  EditOutcome Reshape(const VolumeFilter& filter, const VolumeEditor::Revision& expected,
                      const LoadProgress& progress, const LoadCancelled& cancelled);
  EditOutcome Finish(FilterRun& run, const LoadProgress& progress, const LoadCancelled& cancelled);

  Session& session_;
  VolumeEditor& editor_;
  std::mutex filtering_;
};

}  // namespace palpate
