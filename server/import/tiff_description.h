// What ImageJ and OME write into the description of a TIFF file.
//
// Pure. Threads: any. Errors: none; what cannot be read is not stated.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/geometry/geometry.h"

namespace palpate {

struct TiffDescription {
  bool has_several_channels_or_times = false;  // as successive pages
  std::optional<Vec3> spacing_mm{};            // along x, y and z, if all are stated
  std::int64_t images = 1;                     // ImageJ: of the whole file
};

// `x_per_unit`, `y_per_unit`: the page's resolution, 0 if not stated. ImageJ names its unit in the
// description.
TiffDescription ParseTiffDescription(std::string_view text, double x_per_unit, double y_per_unit);

}  // namespace palpate
