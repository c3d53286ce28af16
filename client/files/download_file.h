// Copies palpated's volume, with its edits, into a file on this machine. The suffix of the name
// selects the format: .nrrd (dense, of the smallest type that holds all voxels) or .vdb (sparse).
//
// Threads: any; waits for palpated. Errors: those of Calls::DownloadVolume, SaveAsNrrd and
// SaveAsVdb; kInvalidArgument (another suffix), kConflict (a recording is replayed), kCancelled.
// After an error, nothing is written and an old file is unchanged.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/calls.h"

namespace palpate::client {

struct DownloadedFile {
  DownloadResult copy;
  double received_s = 0.0;  // the time of the transfer
};

// `progress` is called while the volume is transferred, `check` while the file is written; `check`
// may throw. Refuses what it can before the transfer.
DownloadedFile DownloadToFile(Calls& palpated, const std::string& file, bool overwrite,
                              const ProgressFunction& progress, const std::function<void()>& check);

}  // namespace palpate::client
