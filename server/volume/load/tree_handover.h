// Takes over a volume that is handed over as the leaves and tiles of a tree (handover.h).
//
// Not for real-time code. Threads: any. Errors: Error.
#pragma once

#include "server/volume/load/handover.h"

namespace palpate {

// `metadata`: the header's values, except for the range, which is computed. The file must be
// sealed. Throws kInvalidArgument if the file holds no valid tree or volume; kTooLarge.
LoadedVolume TakeTree(int fd, const HandoverHeader& header, VolumeMetadata metadata,
                      const TakeOptions& options);

}  // namespace palpate
