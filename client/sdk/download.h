// A copy of the whole volume, at one revision.
//
// Threads: plain values.
#pragma once

#include <cstdint>

#include "client/sdk/volume_mirror.h"

namespace palpate::client {

struct DownloadResult {
  // Complete, and compared with the daemon's by its content hash. It has a lattice.
  VolumeMirror volume;
  std::uint64_t bytes_received = 0;  // as they travelled
};

}  // namespace palpate::client
