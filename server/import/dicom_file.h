// Walks the elements of a DICOM file and checks that all of them are complete, above all the
// pixels. GDCM reads truncated files as complete ones, and crashes on some of them.
//
// Pure except for the stream. Threads: one per stream. Errors: palpate::Error without the file's
// name, see image_header.h.
#pragma once

#include <cstdint>
#include <istream>

namespace palpate {

struct DicomFile {
  bool is_dicom = false;    // has the preamble
  bool has_pixels = false;  // is an image
  // The position of the pixels' end; 0 without pixels. Padding may follow.
  std::int64_t pixels_end = 0;
};

// `length`: the bytes of the stream. Refuses files that are truncated or contradict themselves.
DicomFile CheckDicomFile(std::istream* in, std::int64_t length);

}  // namespace palpate
