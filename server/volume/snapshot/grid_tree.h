// Converts a volume to a tree of OpenVDB, with the type and form of its original grid.
//
// Not for real-time code. Threads: any. Ownership: the tree is a copy.
#pragma once

#include <functional>
#include <memory>
#include <string_view>

#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/openvdb_names.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// Returns the type of kGridTypes that holds the volume's values. Candidates are the type of the
// original grid; int32 for voxels that are integers in their file; otherwise float.
std::string_view GridTypeOf(const BrickDirectory& bricks, const VolumeMetadata& metadata);

// Returns the leaf of the next brick, z fastest. It must be valid until the next call.
using NextLeaf = std::function<const Leaf&()>;
NextLeaf LeavesOf(const BrickDirectory& bricks);

// Makes a grid of type Grid. If the volume came from a .vdb file, every value, state, tile and node
// is as it was, except for changes made since. Otherwise, the background is the value outside
// (VolumeMetadata::Background), and voxels that differ from it are active.
template <class Grid>
std::shared_ptr<Grid> MakeGrid(const NextLeaf& next, const VolumeMetadata& metadata);

}  // namespace palpate
