// Writes a tree of OpenVDB's as a hand-over (server/volume/handover_layout.h).
//
// One thread. Errors: palpate::Error.
#pragma once

#include <openvdb/openvdb.h>

#include "server/import/reporter.h"
#include "server/volume/grid_form.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

// Tree: one of those of kGridTypes. All of `metadata` but the range; of `form` what is no part of
// the tree. Voxels that are no finite floats become the least one that is (with a warning). Held in
// the smallest type that holds each voxel exactly; floats stay floats.
template <class Tree>
void WriteTree(int fd, const Tree& tree, const VolumeMetadata& metadata, const GridForm& form,
               Reporter* reporter);

}  // namespace palpate
