// The frames of a time series: loaded, and blended.
//
// Frame: I, one lattice for all. Values in data units, one range for all.
// Threads: LoadSeries on any ordinary thread, blocks until done; Blend is pure.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "server/store/volume_loader.h"
#include "server/volume/brick_directory.h"
#include "server/volume/brick_memory.h"

namespace palpate {

struct LoadedSeries {
  VolumeMetadata metadata;             // of the first frame, but for the range and the frames
  std::vector<BrickDirectory> frames;  // what is equal in several is shared
  std::uint64_t memory_bytes = 0;      // of all frames
};

// One file with several frames, or files of one frame each. Of `request` spacing_mm,
// raw, grid and component are used. The memory of all frames is claimed before the first is read,
// or right after it where only the file tells how many they are. The claim shrinks as they are
// made. Throws Error: as VolumeLoader::Load; kInvalidArgument for fewer than two frames, several in
// one of several files, other sizes, level sets among densities; kTooLarge. `work`: this thread's.
LoadedSeries LoadSeries(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
                        const LoadRequest& request, const LoadProgress& progress,
                        const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                        const BrickWork& work);

// (1 - share) of `from` and `share` of `to`; bricks that both have stay shared. `bytes_known`: told
// of the memory that the others take, before they are made; what it throws ends the blend.
BrickDirectory Blend(const BrickDirectory& from, const BrickDirectory& to, double share,
                     const std::function<void(std::uint64_t bytes)>& bytes_known = {});

}  // namespace palpate
