// What ImageJ and OME write into the description of a TIFF file.
//
// Pure. Threads: any. Errors: none; what cannot be read is not stated.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate {

struct TiffDescription {
  std::string problem{};             // why the pages are no volume; empty: they may be one
  std::optional<Vec3> spacing_mm{};  // along x, y and z, if all are stated
  std::int64_t images = 1;           // ImageJ: of the whole file
  // ImageJ: the value of a voxel is intercept + slope * voxel.
  double slope = 1.0;
  double intercept = 0.0;
  std::string unit{};  // of the values
  std::vector<std::string> warnings{};
  // OME: the page of each slice, and its file if there are several. Empty: in the order of pages.
  std::vector<std::int64_t> page_of_slice{};
  std::vector<std::string> file_of_slice{};
};

// `x_per_unit`, `y_per_unit`: the page's resolution, 0 if not stated. ImageJ names its unit in the
// description.
TiffDescription ParseTiffDescription(std::string_view text, double x_per_unit, double y_per_unit);

}  // namespace palpate
