// A copy of the whole volume, at one revision.
//
// Threads: plain values.
#pragma once

#include <cstdint>

#include "client/sdk/volume_mirror.h"

namespace palpate::client {

struct DownloadResult {
  // Complete. Its content hash equals the daemon's. It has a lattice.
  VolumeMirror volume;
  std::uint64_t bytes_received = 0;  // as transferred
};

}  // namespace palpate::client
