// The header of an NRRD file of one volume. The voxels follow: x fastest, little-endian.
//
// Frames: I voxel indices, W world (mm). Pure; any thread. Format: teem.sourceforge.net/nrrd.
#pragma once

#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

struct NrrdHeader {
  std::string type;      // "float", "uint8", "int16", "uint16"
  std::string encoding;  // of the voxels: "raw", "gzip"
  Vec3i size = Vec3i::Zero();
  AffineMap X_WI;
  bool is_lps = false;  // W is the patient's LPS; otherwise the file does not say what W is
  std::string unit{};   // of the values; empty: none
};

std::string ToText(const NrrdHeader& header);

}  // namespace palpate
