// Filters the session's volume in the background. Each filter is one step of the editor's history.
//
// A filter works on a snapshot, without a lock. When it has finished, it takes its turn in the
// editor and finds the edits made in the meantime. It filters the parts changed by these edits
// again: at once if this is fast, otherwise without the lock, in rounds. So the result equals, to
// the bit, the filter of the volume that it replaces.
// A filter of the whole volume (reshape.h) cannot follow edits: it starts again, and gives up if
// edits continue.
//
// Threads: any ordinary thread; one filter at a time, others are refused. Ownership: borrows both.
// Errors: Error; then nothing changes.
#pragma once

#include <mutex>

#include "server/session/edits/volume_editor.h"
#include "server/session/session.h"
#include "server/volume/edit/filter.h"

namespace palpate {

class VolumeFilterer {
 public:
  VolumeFilterer(Session& session, VolumeEditor& editor) : session_(session), editor_(editor) {}

  // Publishes without waiting for the servo. `expected`: the volume revision at the start; later
  // edits are filtered, too. `progress`: not called while edits wait.
  // Throws:
  //   kInvalidArgument
  //   kTooLarge   above the memory budget
  //   kCancelled
  //   kConflict   another filter runs; the revision is not the expected one; another volume was
  //               loaded; edits change more than the filter can follow. For a filter of the whole
  //               volume, also while a volume is loaded or shown from a series.
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
