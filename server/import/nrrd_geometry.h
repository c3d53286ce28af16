// Computes the place of an NRRD file's voxels.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include "server/import/image_header.h"
#include "server/import/nrrd_fields.h"

namespace palpate {

// Uses the first three axes. Turns the frame into LPS if the header's space is RAS, LAS or LPS, and
// leaves any other space as it is: only these say where it lies in a patient. Lengths are in the
// header's units (space units, or units of axes without a space), or in mm if the header has none.
// A unit that is not known is left to the caller. A header without a space has only spacings; its
// axis mins give the place. A spacing may be negative (RepairSpacing). `spacing_is_given`: only
// their signs matter.
ImageGeometry ParseNrrdGeometry(const NrrdFields& fields, const std::array<std::int64_t, 3>& size,
                                bool spacing_is_given);

}  // namespace palpate
