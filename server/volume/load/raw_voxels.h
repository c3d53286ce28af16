// Describes a file that holds only voxels. Plain values.
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace palpate {

struct RawVoxels {
  std::array<std::int64_t, 3> size{};  // voxels along x (fastest), y, z
  std::string type;  // "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"
  bool big_endian = false;
  std::int64_t offset_bytes = 0;  // position of the first voxel

  bool operator==(const RawVoxels&) const = default;
};

}  // namespace palpate
