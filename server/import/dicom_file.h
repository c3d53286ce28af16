// Walks the elements of a DICOM file and checks that they, above all the pixels,
// are all there: GDCM reads truncated files as whole ones, and crashes on some.
//
// Pure but for the stream. One thread per stream. Errors: palpate::Error without
// the file's name, see image_header.h.
#pragma once

#include <cstdint>
#include <istream>

namespace palpate {

struct DicomFile {
  bool is_dicom = false;    // has the preamble
  bool has_pixels = false;  // is an image
  // Bytes up to the end of the pixels, behind which there may be padding; 0 without pixels.
  std::int64_t pixels_end = 0;
};

// `length`: bytes of the stream. Refuses what is cut off or contradicts itself.
DicomFile CheckDicomFile(std::istream* in, std::int64_t length);

}  // namespace palpate
