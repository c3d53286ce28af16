// Loads and blends the frames of a time series.
//
// Frame: I; all frames have one lattice. Values in data units; all frames have one range.
// Threads: LoadSeries on any ordinary thread, blocks until done; Blend is pure.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "server/live_volume/volume_loader.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/brick_memory.h"

namespace palpate {

struct LoadedSeries {
  VolumeMetadata metadata;  // of the first frame; range and number of frames are of all frames
  std::vector<BrickDirectory> frames;  // frames share equal leaves
  std::uint64_t memory_bytes = 0;      // of all frames
};

// Loads one file with several frames, or several files with one frame each. Uses spacing_mm, raw,
// grid and component of `request`. Claims the memory of all frames before it reads the first frame;
// if only the file tells the number of frames, right after the first frame. The claim shrinks as
// frames are made. Throws Error: as VolumeLoader::Load; kInvalidArgument for fewer than two frames,
// for several frames in one of several files, for different sizes, and for level sets mixed with
// densities; kTooLarge. `work`: the calling thread's.
LoadedSeries LoadSeries(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
                        const LoadRequest& request, const LoadProgress& progress,
                        const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                        const BrickWork& work);

// Returns (1 - share) of `from` plus `share` of `to`. Bricks that both have stay shared.
// `bytes_known`: called with the memory for the other bricks before they are made; an exception
// from it ends the blend.
BrickDirectory Blend(const BrickDirectory& from, const BrickDirectory& to, double share,
                     const std::function<void(std::uint64_t bytes)>& bytes_known = {});

}  // namespace palpate
