// Looks whether the values of a volume are what its file claims, before anybody relies on it.
//
// Threads: one per object. Errors: none.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/import/reporter.h"
#include "server/import/voxel_reader.h"

namespace palpate {

// Hounsfield units have air at -1000. Many files of CT hold the scanner's own numbers, with air at
// 0, and some say so wrongly.
class HounsfieldCheck {
 public:
  // A sink that looks at each voxel and passes it on. Must not outlive this object.
  VoxelSink Watching(VoxelSink sink);

  // Takes the unit HU away, and warns, if the values look like HU + 1024. `is_ct`: a scanner's own
  // series. Its values are no HU either if most are beyond those of HU or, without an offset, if
  // some are near 0 and none below; if it has no unit, says so, too.
  void Judge(bool is_ct, bool has_offset, std::string* unit, Reporter* reporter) const;

 private:
  void Add(float value);

  // Numbers of voxels.
  double count_ = 0.0;
  double plausible_ = 0.0;               // as of air up to metal
  double negative_ = 0.0, low_ = 0.0;    // where fat and air are in HU
  double tissue_ = 0.0, between_ = 0.0;  // near 1024; between it and 0
  double air_ = 0.0, air_sum_ = 0.0;     // near 0
};

// Signed distances from a surface change by 1 for each mm, m, um or voxel across it.
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
