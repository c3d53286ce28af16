#include "server/simulated_hand/rehearsal.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kAboveMm = 2.0;
constexpr double kStepMm = 0.4;
// What the proxy may be farther away from the hand than the surface is.
constexpr double kSlackShare = 0.6;
constexpr double kSlackMm = 0.3;
constexpr double kEjectLimitMm = 3.0;
constexpr int kMovesPerStep = 8;  // that the work of a step is counted for

}  // namespace

Rehearsal::Rehearsal(const HapticSurface& surface) : surface_(surface) {}

std::size_t Rehearsal::Slide(const std::vector<TouchPoint>& points, std::size_t from,
                             std::size_t to) {
  if (!ComeDown(points[from])) return 0;
  std::size_t followed = 1;
  const std::size_t step = from < to ? 1 : static_cast<std::size_t>(-1);
  for (std::size_t n = from; n != to; ++followed) {
    n += step;
    MoveTo(points[n].p_DHand_mm);
    if (!Touches(points[n])) return followed;
  }
  return followed;
}

bool Rehearsal::Crosses(const TouchPoint& from, const TouchPoint& to, const TouchArc& arc) {
  if (!ComeDown(from)) return false;
  const double looks = std::ceil(arc.LengthMm() / (2.0 * kStepMm)) + 4.0;
  for (double look = 1.0; look <= looks; ++look) MoveTo(arc.At(look / looks));
  return Touches(to);
}

bool Rehearsal::ComeDown(const TouchPoint& point) {
  hand_mm_ = point.p_D_mm + kAboveMm * point.normal_D;
  proxy_ = Proxy();
  MoveTo(hand_mm_);
  MoveTo(point.p_DHand_mm);
  return Touches(point);
}

bool Rehearsal::Touches(const TouchPoint& point) const {
  const double depth_mm = (point.p_D_mm - point.p_DHand_mm).norm();
  return proxy_.on_surface() &&
         (proxy_.p_DH_mm - hand_mm_).norm() <= (1.0 + kSlackShare) * depth_mm + kSlackMm;
}

// In steps as of ticks, or a few of them.
void Rehearsal::MoveTo(const Vec3& p_D_mm) {
  const Vec3 way_mm = p_D_mm - hand_mm_;
  const double parts = std::max(1.0, std::ceil(way_mm.norm() / kStepMm));
  for (double part = 1.0; part <= parts; ++part) {
    const Vec3 hand_mm = p_D_mm - (1.0 - part / parts) * way_mm;
    const ProxyStep step = StepProxy(surface_, hand_mm, kEjectLimitMm, proxy_, *cache_);
    steps_ += 1 + step.moves / kMovesPerStep;
  }
  hand_mm_ = p_D_mm;
}

}  // namespace palpate
