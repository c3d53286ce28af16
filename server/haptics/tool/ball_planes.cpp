#include "server/haptics/tool/ball_planes.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Planes that a nearest move looks at cost as much as one tetrahedron.
constexpr int kPlanesPerWork = 8;

bool IsAmong(std::span<const BallPlane> planes, const BallPlane& plane) {
  return std::ranges::find(planes, plane) != planes.end();
}

}  // namespace

bool BallPlanes::Holds(const BallPlane& plane) const {
  const double there = balls_.excess[plane.ball];
  const double excess = plane.plane.Excess(balls_.p_mm[plane.ball]);
  return excess <= std::max(there, 0.0) + kDensityMargin &&
         (std::isinf(there) || excess <= there + kDensityMargin);
}

bool BallPlanes::Knows(const BallPlane& plane) const { return IsAmong(held_.all(), plane); }

void BallPlanes::AddNear(const BallPlane& plane) {
  if (Holds(plane)) near_.Add(plane);
}

void BallPlanes::DropKept() {
  int left = 0;
  for (const BallPlane& plane : kept_.all()) {
    if (Holds(plane)) kept_.item[static_cast<std::size_t>(left++)] = plane;
  }
  kept_.count = left;
}

void BallPlanes::Keep(const BallPlane& plane) {
  if (!IsAmong(kept_.all(), plane)) kept_.Add(plane);
  held_.Add(plane);
}

void BallPlanes::Hold(std::span<const BallPlane> planes, int but_of) {
  for (const BallPlane& plane : planes) {
    if (plane.ball != but_of) held_.Add(plane);
  }
}

HeldMove BallPlanes::Solve(const Vec6& wanted, Limits limits, std::span<const BallPlane> beyond,
                           int most_work, int& work, bool& capped) noexcept {
  held_.count = 0;
  const int thin_ball = beyond.empty() ? -1 : beyond.front().ball;
  const int but_of = limits == Limits::kBeyond ? thin_ball : -1;
  Hold(near_.all(), but_of);
  Hold(kept_.all(), but_of);
  Hold(beyond, -1);
  const int before = work;
  LeastMove nearest = Nearest(wanted, limits, thin_ball, most_work, work, capped);
  if (!nearest.feasible && limits == Limits::kRestore) {
    nearest = Nearest(wanted, Limits::kKeep, thin_ball, most_work - (work - before), work, capped);
  }
  if (!nearest.feasible) return {};
  HeldMove move{.x = nearest.x};
  for (int n = 0; n < nearest.active_count; ++n) {
    const BallPlane& active = held_.item[static_cast<std::size_t>(nearest.active[n])];
    move.active |= std::uint64_t{1} << active.ball;
    move.slope_per_mm = std::min(move.slope_per_mm, active.plane.slope);
  }
  move.active_count = nearest.active_count;
  return move;
}

LeastMove BallPlanes::Nearest(const Vec6& wanted, Limits limits, int thin_ball, int most_work,
                              int& work, bool& capped) noexcept {
  for (int n = 0; n < held_.count; ++n) {
    const auto& [ball, plane] = held_.item[static_cast<std::size_t>(n)];
    const double gap_mm = plane.Gap(balls_.p_mm[ball]);
    double floor_mm = limits == Limits::kRestore ? standoff_mm_ : std::min(standoff_mm_, gap_mm);
    if (ball == thin_ball) floor_mm = kThinStandoffs * standoff_mm_;
    limits_[n].along << plane.normal_D, balls_.arm_mm[ball].cross(plane.normal_D) / rho_mm_;
    limits_[n].least = floor_mm - gap_mm;
  }
  const int count = std::max(1, held_.count);
  const int most_steps = std::min(kMostLeastMoveSteps, kPlanesPerWork * most_work / count);
  const LeastMove move =
      NearestMove(wanted, {limits_.data(), static_cast<std::size_t>(held_.count)},
                  1e-3 * standoff_mm_, most_steps);
  work += count * move.steps / kPlanesPerWork;
  capped = capped || (move.steps == most_steps && most_steps < kMostLeastMoveSteps);
  return move;
}

}  // namespace palpate
