// The values of a DICOM slice, through GDCM. GDCM sees a file of ours with nothing but the pixels
// and their description: other elements, odd types of elements and padding do not reach it.
//
// Threads: one. Reads files. Errors: palpate::Error.
#pragma once

#include <vector>

#include "server/import/dicom_slice.h"

namespace palpate {

// Returns the values, with rescale or table, x fastest.
std::vector<float> ReadDicomPixels(const DicomSlice& slice);

}  // namespace palpate
