// Small NRRD files for tests.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate::testing {

// Floats with spacing 1 mm: value(i, j, k).
inline std::string NrrdBytes(const Vec3i& size, const std::function<float(int, int, int)>& value) {
  std::string bytes = "NRRD0004\ntype: float\ndimension: 3\nsizes: " + std::to_string(size.x()) +
                      " " + std::to_string(size.y()) + " " + std::to_string(size.z()) +
                      "\nspacings: 1 1 1\nendian: little\nencoding: raw\n\n";
  for (int k = 0; k < size.z(); ++k) {
    for (int j = 0; j < size.y(); ++j) {
      for (int i = 0; i < size.x(); ++i) {
        const float v = value(i, j, k);
        bytes.append(reinterpret_cast<const char*>(&v), sizeof(v));
      }
    }
  }
  return bytes;
}

inline void WriteNrrd(const std::filesystem::path& path, const Vec3i& size,
                      const std::function<float(int, int, int)>& value) {
  std::ofstream(path, std::ios::binary) << NrrdBytes(size, value);
}

}  // namespace palpate::testing
