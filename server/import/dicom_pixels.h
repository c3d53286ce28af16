// The values of a DICOM slice, through GDCM. GDCM sees a file of ours with nothing but the pixels
// and their description: other elements, odd types of elements and padding do not reach it.
//
// Threads: one. Reads files. Errors: palpate::Error.
#pragma once

#include <limits>
#include <vector>

#include "server/import/dicom_slice.h"

namespace palpate {

struct DicomPixels {
  // With rescale or table, x fastest. Padding is not a number.
  std::vector<float> values;
  float least_padding = std::numeric_limits<float>::infinity();
  // Pixels have something in more bits than BitsStored says. These are left out, unless all bits
  // are taken: of a compressed slice, or if signs show that numbers have them.
  bool has_more_bits = false;
  bool takes_all_bits = false;
  // Pixels have their sign in the highest of the bits that are stored, and none above.
  bool has_short_signs = false;
  // Negative pixels have the bits above set, too, and no other has a sign in those that are stored.
  bool has_long_signs = false;
};

DicomPixels ReadDicomPixels(const DicomSlice& slice);

}  // namespace palpate
