#include "server/lab/replay_judge.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "server/lab/proxy_judges.h"

namespace palpate::lab {
namespace {

bool IsEjecting(const ProxyStep& step) {
  return step.mode == ProxyMode::kEjecting || step.mode == ProxyMode::kInside;
}

class Judge {
 public:
  Judge(const HapticSurface& surface, const HapticSettings& settings, const TriangleGrid& triangles)
      : surface_(surface),
        settings_(settings),
        triangles_(triangles),
        own_side_(surface),
        other_side_(surface.Flipped()),
        side_(surface.free_side) {
    if (settings.static_friction > 0.0 || settings.dynamic_friction > 0.0) {
      verdict_.sticks = std::nullopt;
    }
  }

  void Take(const ReplayTick& tick) {
    own_side_.Trim();
    other_side_.Trim();
    const HapticOutput& output = tick.output;
    verdict_.rejected_ticks += output.input_rejected;
    if (!tick.placed) {
      verdict_.density.push_back(std::numeric_limits<double>::quiet_NaN());
      return;
    }
    const Vec3& p_DH_mm = output.proxy.p_DH_mm;
    if (output.free_side != side_) {
      side_ = output.free_side;
      last_mm_ = std::nullopt;
    }
    const double density = cells().HoldersOf(surface_.X_LD.Apply(p_DH_mm)).Density();
    verdict_.density.push_back(surface_.volume->Denormalize(density));
    verdict_.contact_ticks += IsInContact(output);
    verdict_.iteration_cap_hits += output.proxy.capped;
    if (IsInContact(output)) JudgeVisual(output.proxy, tick.visual);
    if (IsEjecting(output.proxy)) {
      ++verdict_.ejecting_ticks;
      last_mm_ = std::nullopt;
      return;
    }
    verdict_.fall_throughs += HasFallenThrough(output, density);
    last_mm_ = p_DH_mm;
    JudgeRest(output);
  }

  Verdict Finish() { return std::move(verdict_); }

 private:
  // The cells as seen from the side that the proxy is on.
  FreshCells& cells() { return side_ == surface_.free_side ? own_side_ : other_side_; }

  bool HasFallenThrough(const HapticOutput& output, double density) {
    // Also true for NaN, the density in a gap of the decomposition.
    if (!(cells().Inside(density) <= kDensityTolerance)) return true;
    if (!last_mm_) return false;
    const FreePath path = FindFreePath(cells(), *last_mm_, output.proxy.p_DH_mm, output.p_DHip_mm);
    verdict_.unchecked_ticks += path == FreePath::kUnchecked;
    return path == FreePath::kNone;
  }

  void JudgeRest(const HapticOutput& output) {
    const bool excess = IsExcessive(output);
    verdict_.excess_force_ticks += excess;
    if (!verdict_.sticks) return;
    const bool rests = !output.proxy.capped;
    const bool at_minimum =
        rests && IsLocalMinimum(cells(), output.proxy.p_DH_mm, output.p_DHip_mm);
    *verdict_.sticks += rests && !at_minimum;
    verdict_.excess_off_minimum_ticks += excess && !at_minimum;
  }

  // Searches only up to the distance at which the force would be right.
  bool IsExcessive(const HapticOutput& output) const {
    const double over_n = output.spring_D_n.norm() - kExcessForceN;
    if (!(over_n > 0.0)) return false;
    const double expected_mm = over_n / (kExcessFactor * settings_.stiffness_n_per_mm);
    return triangles_.Distance(output.p_DHip_mm, expected_mm) < expected_mm;
  }

  void JudgeVisual(const ProxyStep& proxy, const VisualProxy& visual) {
    if (!visual.found) return;
    ++verdict_.scp_v_ticks;
    verdict_.scp_hv_voxels += (visual.p_DV_mm - proxy.p_DH_mm).norm() / surface_.voxel_mm;
    const double cosine = std::clamp(visual.normal_D.dot(proxy.normal_D), -1.0, 1.0);
    verdict_.force_angle_deg += std::acos(cosine) * 180.0 / std::numbers::pi;
    const Vec3 p_IV = surface_.X_ID.Apply(visual.p_DV_mm);
    const Vec3i cell = p_IV.array().floor().matrix().cast<int>();
    const Trilinear f(surface_.Felt(surface_.volume->StoredCell(cell)));
    const Vec3 local = p_IV - cell.cast<double>();
    const double error = std::abs(f.Value(local) - surface_.isovalue);
    const bool on_v =
        error <= kDensityTolerance || error <= kVisualToleranceVoxels * f.Gradient(local).norm();
    verdict_.scp_v_off_ticks += !on_v;
  }

  const HapticSurface& surface_;
  const HapticSettings& settings_;
  const TriangleGrid& triangles_;
  FreshCells own_side_, other_side_;
  FreeSide side_;
  std::optional<Vec3> last_mm_;  // where the path of this tick begins; empty: no path is judged
  Verdict verdict_;
};

}  // namespace

Verdict JudgeReplay(const HapticSurface& surface, const HapticSettings& settings,
                    const TriangleGrid& surface_triangles, const std::vector<ReplayTick>& ticks) {
  Judge judge(surface, settings, surface_triangles);
  for (const ReplayTick& tick : ticks) judge.Take(tick);
  return judge.Finish();
}

}  // namespace palpate::lab
