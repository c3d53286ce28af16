// Isovalues at which a volume shows something, and the histogram that they come from.
//
// The first suggestion is where a load starts if it names no isovalue:
//   level sets            "surface", 0
//   built-in shapes       "surface", the middle of the range
//   CT in Hounsfield units  "bone", 300 HU; then "skin", -300 HU, and "otsu"
//   all others            "otsu", Otsu's threshold over the values that are not background. With a
//                         peak or a background where air is in CT, and no unit, "bone" and "skin"
//                         follow
// A preset that the volume has hardly any voxels for is left out. The background is the value that
// at least a quarter of all voxels have; many volumes have none, and CT in Hounsfield units has air
// instead.
//
// Programs fill what a CT scanner does not see with values that no scanner measures, such as -3024.
// In a CT that has such values at its border, all values below -1024 count as -1024. So does noise
// of air, so that padding changes nothing.
//
// Values in data units. Threads: pure, any. Not for real-time code: at most 2^25 voxels are read,
// about 0.1 s. Of a larger volume, each n-th brick is read. Errors: none.
// Source: N. Otsu, "A Threshold Selection Method from Gray-Level Histograms", IEEE Transactions on
// Systems, Man, and Cybernetics 9 (1979), pp. 62-66.
#pragma once

#include <vector>

#include "common/contract/volume.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

struct VolumeValues {
  // Voxels in equal bins over low .. high. Values outside count in the first and the last bin. The
  // bins cover the volume's range, or, if a few outliers make that useless, nearly all values. Of
  // whole numbers, if there are few, each has a bin with the number in its middle.
  ValueHistogram histogram;
  std::vector<SuggestedIsovalue> suggested;  // never empty; the first is the start
  bool has_padding = false;                  // of a CT, at the border
};

VolumeValues ValuesOf(const VolumeSnapshot& volume);

}  // namespace palpate
