// One slice of a DICOM series, from the elements of its file.
//
// Frames: W world (mm, LPS). Pure. Threads: any. Errors: palpate::Error without the file's name,
// see image_header.h.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/import/dicom_file.h"
#include "server/import/image_header.h"

namespace palpate {

// Tolerance for the unit vectors along rows and columns.
inline constexpr double kParallelSlices = 1e-3;

struct DicomSlice {
  std::filesystem::path file;
  DicomFile content;
  // What orders the slices; empty: their places. Without a place, position_W_mm is on the z axis.
  std::string_view order;
  Vec3 position_W_mm;
  Vec3 row_W;     // unit vector along x
  Vec3 column_W;  // unit vector along y
  std::array<double, 2> spacing_mm{};
  std::array<std::int64_t, 2> size{};
  ScalarType type = ScalarType::kInt16;
  // Where the value lies in the bits of a pixel, which is unsigned or in two's complement.
  int low_bit = 0;
  int bits = 16;
  bool is_signed = false;
  // The pixels that are no picture, such as the corners around a round one: PixelPaddingValue, up
  // to PixelPaddingRangeLimit. None: least is above greatest.
  std::int64_t least_padding = 1;
  std::int64_t greatest_padding = 0;
  // Of the values, without content.table.
  double slope = 1.0;
  double intercept = 0.0;
  std::string unit;
  // Of the values' picture: the first that the file proposes. Width 0: none.
  double window_level = 0.0;
  double window_width = 0.0;
  bool is_ct = false;
};

// What was found about files, by kind, for one line of a message.
class FileNotes {
 public:
  void Add(const std::string& what, const std::filesystem::path& file) {
    files_[what].push_back(FileName(file));
  }
  bool empty() const { return files_.empty(); }
  // "'a', 'b': WHAT; ..." with the first few names.
  std::string Text() const;

 private:
  std::map<std::string, std::vector<std::string>> files_;
};

// Refuses what is no slice of a grey volume. `repairs`: what was repaired is added.
DicomSlice ParseSlice(const std::filesystem::path& file, DicomFile content,
                      const ImportLimits& limits, FileNotes* repairs);

}  // namespace palpate
