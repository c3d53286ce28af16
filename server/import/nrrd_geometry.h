// Where the voxels of an NRRD file lie.
//
// Pure. Any thread. Errors: palpate::Error, see image_header.h.
#pragma once

#include "server/import/image_header.h"
#include "server/import/nrrd_fields.h"

namespace palpate {

// Of the first three axes. The frame is turned into LPS where the header's space is
// RAS or LAS, and taken as it is for any other. Lengths are in the units that it states (space
// units, or units of axes without a space), in mm if it states none. A header without a space has
// spacings only, and its axis mins place it.
ImageGeometry ParseNrrdGeometry(const NrrdFields& fields, const std::array<std::int64_t, 3>& size);

}  // namespace palpate
