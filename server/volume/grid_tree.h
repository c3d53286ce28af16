// A volume as a tree of OpenVDB's, in the type and the form of the grid that it came from.
//
// Not for real-time code. Threads: any. Ownership: the tree is a copy.
#pragma once

#include <memory>
#include <string_view>

#include "server/volume/brick_directory.h"
#include "server/volume/openvdb_names.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

// The type of kGridTypes that holds what the volume holds: that of the grid it came from, int32 for
// voxels that are integers in its file, else float.
std::string_view GridTypeOf(const BrickDirectory& bricks, const VolumeMetadata& metadata);

// Of type Tree::ValueType. Of a volume out of a .vdb file every value, state, tile and node is as
// it was, but for what was changed since. Of another one the background is the end of the range
// that is outside, and what differs from it is active.
template <class Grid>
std::shared_ptr<Grid> MakeGrid(const BrickDirectory& bricks, const VolumeMetadata& metadata);

}  // namespace palpate
