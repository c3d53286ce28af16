// Takes a volume that is handed over as the leaves and tiles of a tree (handover_layout.h).
//
// Not for real-time code. Threads: any. Errors: Error.
#pragma once

#include "server/volume/handover.h"

namespace palpate {

// `metadata`: what the header says, but for the range, which is found. The file is sealed.
// kInvalidArgument for what is no tree, or no volume; kTooLarge.
LoadedVolume TakeTree(int fd, const HandoverHeader& header, VolumeMetadata metadata,
                      const TakeOptions& options);

}  // namespace palpate
