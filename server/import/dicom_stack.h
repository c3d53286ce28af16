// Makes a stack of DICOM slices: sorts them, and finds where the volume's slices lie. Says or
// refuses what differs from the places that the files state.
//
// Frames: W world (mm, LPS). A place is in mm along the rows, the columns and the normal.
// Threads: one. Errors: palpate::Error, see image_header.h.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/import/dicom_slice.h"
#include "server/import/image_header.h"
#include "server/import/reporter.h"

namespace palpate {

// Slices of one size, spacing and orientation, sorted along their normal. Their places, first voxel
// first: mm along the rows, the columns and the normal.
struct DicomStack {
  std::vector<DicomSlice> slices;
  std::vector<Vec3> places_mm;
  Mat3 direction;          // columns: rows, columns and normal in W
  Vec3 first_mm;           // where the volume begins, as a place
  double pitch_mm = 0.0;   // of the volume's slices
  std::int64_t count = 0;  // of the volume's slices
  bool is_resampled = false;
};

// `slices`: at least two, of one size, spacing and orientation. Refuses slices that lie beside the
// line of the others or at one place, or leave a gap. Unevenly spaced slices are to be resampled,
// if `limits` lets it; warnings say so.
DicomStack MakeStack(std::vector<DicomSlice> slices, const ImportLimits& limits,
                     Reporter* reporter);

}  // namespace palpate
