// Looks whether the values of a volume are what its file claims, before anybody relies on it.
//
// Threads: one per object. Errors: none.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/import/reporter.h"

namespace palpate {

// Hounsfield units have air at -1000. Many files of CT hold the scanner's own numbers, with air at
// 0, and some say so wrongly.
class HounsfieldCheck {
 public:
  void Add(const float* values, std::size_t count);

  // Takes the unit HU away, and warns, if the values look like HU + 1024. `is_ct`: a scanner's own
  // series, whose values are no HU either if many are near 0 and none below; says so, too, if it
  // has no unit.
  void Judge(bool is_ct, std::string* unit, Reporter* reporter) const;

 private:
  float least_ = std::numeric_limits<float>::infinity();
  std::int64_t count_ = 0;
  std::int64_t air_ = 0;     // values near 0
  std::int64_t tissue_ = 0;  // values near 1024
};

// Signed distances from a surface change by 1 for each mm, or for each voxel, across it.
class DistanceCheck {
 public:
  // `gradient`: per voxel along each axis, beside the surface at 0.
  void AddGradient(const Vec3& gradient) { gradients_.push_back(gradient); }
  // A value at the volume's border, or beyond it.
  void AddOutside(float value);

  enum class Verdict { kNoDistances, kNegativeOutside, kPositiveOutside, kBothOutside };
  Verdict Judge(const Vec3& spacing_mm) const;

 private:
  std::vector<Vec3> gradients_;
  std::int64_t positive_ = 0, outside_ = 0;
};

// Tells the user what was found in a file that does not say it. Returns true if the volume is to be
// felt as a level set: its outside is positive.
bool IsLevelSet(DistanceCheck::Verdict verdict, Reporter* reporter);

}  // namespace palpate
