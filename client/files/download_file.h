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
#include "common/bricks/brick_map.h"
#include "common/bricks/volume_event.h"

namespace palpate::client {

// What a lattice does not tell of the file that the volume was loaded from.
struct VdbOrigin {
  std::string original_type{};  // such as "uint8"; empty: the lattice's type
  int frames = 1;
  std::string patient_axes{};  // as the file stated them; empty: it did not
};

// Writes a downloaded volume as a .vdb file that palpated and other programs read: one grid, int32
// if all bricks hold integers, else float. Its metadata palpate_* are those of palpated's own
// files.
//
// The grid's voxel (0,0,0) is the volume's. Its transform maps index to W (mm, LPS). Active are the
// voxels that differ from the background; of a level set those of its band, which also differ from
// the background's negative. Bricks of background are left out, bricks of another value are tiles.
// Memory and file take what the other bricks take as int32 or float: 4 bytes per voxel.
//
// Threads: any. Errors: kConflict (the file exists), kInvalidArgument (no regular file: a folder, a
// link), kNotFound (no such folder for the file), kPermissionDenied, kDiskFull.
//
// `bricks` are those of the lattice. `check` is called now and then and may throw. The file is
// written next to its place and then renamed, so that it is always complete.
void SaveAsVdb(const BrickMap& bricks, const VolumeLattice& lattice, const VdbOrigin& origin,
               const std::string& path, bool overwrite = false,
               const std::function<void()>& check = {});

struct DownloadedFile {
  DownloadResult copy;
  double received_s = 0.0;  // the time of the transfer
};

// `progress` is called while the volume is transferred, `check` while the file is written; `check`
// may throw. Refuses what it can before the transfer.
DownloadedFile DownloadToFile(Calls& palpated, const std::string& file, bool overwrite,
                              const ProgressFunction& progress, const std::function<void()>& check);

}  // namespace palpate::client
