// Fig. 9: leads our proxy and a GBID round a cylinder in contact.
//
// builtin:cylinder has density 1 on the axis, falling by 1/50 per voxel. τ is 0.53 in data units,
// which gives a radius of 23.5. The HIP circles 1 voxel below the surface; the spacing is 1 mm, the
// speed 10 cm/s at 1 kHz.
//
// Threads: any ordinary thread. Apart for its tests.
#pragma once

#include <string>
#include <vector>

namespace palpate::lab {

struct DriftLap {
  double seconds = 0.0;   // since contact, at the end of the lap
  double isovalue = 0.0;  // F at the proxy at the end of the lap, data units
  double worst = 0.0;     // largest |F - τ| during the lap
};

struct DriftCurve {
  std::string name;
  std::vector<DriftLap> laps;
  std::vector<double> isovalue;  // F at the proxy, 100 times a lap
};

inline constexpr double kDriftIsovalue = 0.53;

// Returns four curves: our proxy; our proxy measured by the density of H instead of V; a GBID
// without correction of the value; a GBID with that correction.
std::vector<DriftCurve> MeasureDrift(int laps);

}  // namespace palpate::lab
