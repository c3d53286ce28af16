#include "server/lab/drift.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "server/haptics/proxy.h"
#include "server/lab/gbid.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate::lab {
namespace {

constexpr double kHipRadius = 22.5;  // in voxels and in mm
constexpr double kStepMm = 0.1;      // 10 cm/s at 1 kHz
constexpr int kPlotPointsPerLap = 100;
const Vec3 kAxis(49.5, 49.5, 15.2);

Vec3 HipAt(double angle, double radius) {
  return kAxis + radius * Vec3(std::cos(angle), std::sin(angle), 0.0);
}

// `step` moves a proxy to the HIP and returns the isovalue there, in data units.
DriftCurve Lead(const std::string& name, int laps, const std::function<double(const Vec3&)>& step) {
  const int ticks = static_cast<int>(2.0 * std::numbers::pi * kHipRadius / kStepMm);
  DriftCurve curve{name, {}, {}};
  step(HipAt(0.0, 30.0));
  step(HipAt(0.0, kHipRadius));
  for (int lap = 0; lap < laps; ++lap) {
    DriftLap result;
    for (int tick = 1; tick <= ticks; ++tick) {
      const double turn = static_cast<double>(tick) / ticks;
      result.isovalue = step(HipAt(2.0 * std::numbers::pi * turn, kHipRadius));
      result.worst = std::max(result.worst, std::abs(result.isovalue - kDriftIsovalue));
      if (tick % (ticks / kPlotPointsPerLap) == 0) curve.isovalue.push_back(result.isovalue);
    }
    result.seconds = (lap + 1) * ticks * 1e-3;
    curve.laps.push_back(result);
  }
  return curve;
}

}  // namespace

std::vector<DriftCurve> MeasureDrift(int laps) {
  const BuiltinVolume cylinder = MakeBuiltin("builtin:cylinder");
  const auto volume = MakeSnapshot(cylinder.grid, cylinder.metadata, 1);
  const double isovalue = volume->Normalize(kDriftIsovalue);
  const auto value_at = [&](const Vec3& p) {
    return volume->Denormalize(SampleField(*volume, p).value);
  };
  const HapticSurface surface =
      MakeHapticSurface(*volume, AffineMap{}, isovalue, DecompositionMethod::kTpbcc, 1);
  constexpr double kEjectLimitMm = 10.0;
  std::vector<DriftCurve> curves;
  for (bool own_density : {false, true}) {
    Proxy proxy;
    CellCache cache;
    curves.push_back(Lead(own_density ? "ours, density of H" : "ours", laps, [&](const Vec3& hip) {
      const ProxyStep step = StepProxy(surface, hip, kEjectLimitMm, proxy, cache);
      return own_density ? volume->Denormalize(step.density) : value_at(step.p_DH_mm);
    }));
  }
  for (double correction : {0.0, 1.0}) {
    Gbid proxy;
    curves.push_back(
        Lead(correction == 0.0 ? "GBID" : "GBID, corrected", laps, [&](const Vec3& hip) {
          StepGbid(*volume, isovalue, hip, correction, proxy);
          return value_at(proxy.p_I);
        }));
  }
  return curves;
}

}  // namespace palpate::lab
