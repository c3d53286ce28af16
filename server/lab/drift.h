// Fig. 9: a proxy led round a cylinder in contact, ours and a GBID.
//
// builtin:cylinder: density 1 on the axis, falling by 1/50 per voxel; τ = 0.53 in
// data units, which is radius 23.5. The HIP circles 1 voxel below the surface,
// spacing 1 mm, 10 cm/s at 1 kHz.
//
// Threads: any ordinary thread.
#pragma once

#include <string>
#include <vector>

namespace palpate::lab {

struct DriftLap {
  double seconds = 0.0;   // since contact, at the end of the lap
  double isovalue = 0.0;  // F at the proxy then, data units
  double worst = 0.0;     // largest |F - τ| during the lap
};

struct DriftCurve {
  std::string name;
  std::vector<DriftLap> laps;
  std::vector<double> isovalue;  // F at the proxy, 100 times a lap
};

inline constexpr double kDriftIsovalue = 0.53;

// Ours; ours as its own density sees it (that of H, not of V); a GBID without and
// with the value's correction.
std::vector<DriftCurve> MeasureDrift(int laps);

}  // namespace palpate::lab
