// Writes a tree of OpenVDB as a hand-over (server/volume/load/handover.h).
//
// Threads: one. Errors: palpate::Error.
#pragma once

#include "server/import/reporter.h"
#include "server/volume/snapshot/grid_tree.h"
#include "server/volume/snapshot/openvdb_grids.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// Tree: one of kGridTypes. `metadata`: complete except for the value range. `form`: only the parts
// that are not in the tree. Voxels that are no finite floats become the least finite value (with a
// warning). The voxels are held in the smallest type that holds each voxel exactly; floats stay
// floats.
template <class Tree>
void WriteTree(int fd, const Tree& tree, const VolumeMetadata& metadata, const GridForm& form,
               Reporter* reporter);

}  // namespace palpate
