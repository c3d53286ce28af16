// Reads the numbers of a NIfTI header, of both versions and both byte orders.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace palpate {

struct NiftiFields {
  bool big_endian = false;
  std::int64_t least_vox_offset = 0;  // the header and the four bytes after it
  int datatype = 0;
  int bitpix = 0;
  std::array<std::int64_t, 8> dim{};
  std::array<double, 8> pixdim{};
  double vox_offset = 0.0;
  double scl_slope = 0.0;
  double scl_inter = 0.0;
  int qform_code = 0;
  int sform_code = 0;
  std::array<double, 6> quaternion{};  // b, c, d and the offsets x, y, z
  std::array<double, 12> srow{};       // 3 rows of 4
  int xyzt_units = 0;
};

// Refuses data that are no NIfTI header, are too short, or name a second file.
NiftiFields ReadNiftiFields(std::string_view head);

}  // namespace palpate
