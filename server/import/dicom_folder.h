// Finds the slices of one volume in a folder of DICOM files: the largest stack that fits, whatever
// else lies there.
//
// Threads: one. Reads files. Errors: palpate::Error without the folder's name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "server/import/dicom_slice.h"

namespace palpate {

struct DicomFolder {
  std::vector<DicomSlice> slices;  // of one series, size, orientation and pixel spacing
  std::string left_out;            // which files and why, for a message; empty: none
  std::vector<std::string> warnings;
};

// Looks below the folder, too, if it holds no stack itself. `limits.series`: the SeriesInstanceUID
// to take; empty: the series with the largest stack.
DicomFolder ScanDicomFolder(const std::filesystem::path& folder, const ImportLimits& limits);

}  // namespace palpate
