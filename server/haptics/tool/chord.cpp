#include "server/haptics/tool/chord.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

// Tetrahedra overlap by this, in barycentric weights, so that rounding leaves no gap between them:
// a metre from the origin, with voxels of a hundredth of a millimetre, it is 1e-11.
constexpr double kOverlap = 1e-10;

// The vertices above the bound.
unsigned VerticesAbove(const HapticCell& cell, double bound) {
  unsigned above = 0;
  for (unsigned left = cell.parts.complex.used_vertices; left; left &= left - 1) {
    const int v = std::countr_zero(left);
    above |= static_cast<unsigned>(cell.parts.density[v] > bound) << v;
  }
  return above;
}

// Whether a box lies beyond one side of the padded lattice.
bool IsBeyondASide(const HapticSurface& surface, const Vec3& low, const Vec3& high) {
  return (high.array() < -1.0).any() ||
         (low.array() > surface.lattice.size().cast<double>().array()).any();
}

SurfacePlane PlaneOf(const HapticCell& cell, int tetrahedron, const HalfSpace& fall, double bound) {
  const int v = cell.parts.complex.vertices[tetrahedron][0];
  const double slope = std::sqrt(fall.normal2);
  const Vec3 normal_D = fall.normal / slope;
  // Where the density of the vertex is the bound's.
  return {
      normal_D,
      normal_D.dot(cell.origin_mm + cell.vertex_mm[v]) + (cell.parts.density[v] - bound) / slope,
      slope};
}

// A chord through one tetrahedron after the other.
class Chord {
 public:
  Chord(const HapticSurface& surface, const Vec3& from_mm, const Vec3& to_mm, ToolCellCache& cache,
        int& work)
      : surface_(surface),
        from_mm_(from_mm),
        to_mm_(to_mm),
        way_mm_(to_mm - from_mm),
        bound_(DensityBound(surface)),
        cache_(cache),
        work_(work) {}

  std::optional<ChordHit> Run() noexcept {
    const Vec3 from = surface_.X_LD.Apply(from_mm_), to = surface_.X_LD.Apply(to_mm_);
    const Vec3 way = to - from;
    // Far places do not fit an integer.
    if (IsBeyondASide(surface_, from.cwiseMin(to), from.cwiseMax(to))) {
      if (surface_.IsFreeOutside()) return std::nullopt;
      return ChordHit{.share = 0.0, .plane = {}};
    }
    Vec3i cell = from.array().floor().matrix().cast<int>();
    Vec3 next;  // share of the chord after which it leaves the cell, along each axis
    const auto leaves = [&](int axis) {
      if (way[axis] == 0.0) return std::numeric_limits<double>::infinity();
      return (cell[axis] + (way[axis] > 0.0 ? 1 : 0) - from[axis]) / way[axis];
    };
    for (int axis = 0; axis < 3; ++axis) next[axis] = leaves(axis);
    double entered = 0.0;
    for (;;) {
      ++work_;
      if (Visit(cell, entered)) return hit_;
      int axis = 0;
      entered = next.minCoeff(&axis);
      if (!(entered <= 1.0)) return std::nullopt;
      cell[axis] += way[axis] > 0.0 ? 1 : -1;
      next[axis] = leaves(axis);
    }
  }

 private:
  bool Visit(const Vec3i& at, double entered) noexcept {
    if (!surface_.lattice.HasCell(at)) {
      hit_ = {entered, std::nullopt};
      return !surface_.IsFreeOutside();
    }
    HapticCell& cell = cache_.Densities(surface_, at);
    if (cell.IsFree(surface_)) return false;
    if (!cell.IsCrossed(surface_)) {
      hit_ = {entered, std::nullopt};
      return true;
    }
    cache_.Decompose(surface_, cell);
    const Vec3 from_mm = from_mm_ - cell.origin_mm, to_mm = to_mm_ - cell.origin_mm;
    const TetrahedralComplex& complex = cell.parts.complex;
    const unsigned above = VerticesAbove(cell, bound_);
    hit_.share = std::numeric_limits<double>::infinity();
    int first = -1;
    for (int t = 0; t < complex.tetrahedron_count; ++t) {
      if ((complex.vertex_mask[t] & above) == 0) continue;
      ++work_;
      const double share = HitIn(cell, t, from_mm, to_mm, hit_.share);
      if (share < hit_.share) hit_.share = share, first = t;
    }
    if (first < 0) return false;
    hit_.plane = PlaneOf(cell, first, cache_.Gradients(cell, first).fall, bound_);
    return true;
  }

  // Where the density rises above the bound, before `until`. It does not fall from above it: then
  // it would have risen before.
  double HitIn(HapticCell& cell, int t, const Vec3& from_mm, const Vec3& to_mm,
               double until) noexcept {
    const auto& v = cell.parts.complex.vertices[t];
    const TetrahedronGradients gradients = cache_.Gradients(cell, t);
    const Vec3 &base = cell.vertex_mm[v[0]], &fall = gradients.fall.normal;
    const double room = bound_ - cell.parts.density[v[0]];  // to the bound, from the first vertex
    const double start = room + fall.dot(from_mm - base), end = room + fall.dot(to_mm - base);
    if (!(end < 0.0) || !(end < start)) return until;
    double enter = std::max(0.0, start / (start - end));
    double leave = std::min(until, 1.0);
    Vec3 weight, rate;
    for (int n = 0; n < 3; ++n) {
      const Vec3& normal = gradients.weight[static_cast<std::size_t>(n) + 1].normal;
      weight[n] = normal.dot(from_mm - base);
      rate[n] = normal.dot(way_mm_);
    }
    const auto cut = [&](double at_start, double change) {
      const double inside = at_start + kOverlap;
      if (change > 0.0) {
        if (inside < 0.0) enter = std::max(enter, -inside / change);
      } else if (change < 0.0) {
        leave = std::min(leave, -inside / change);
      } else if (inside < 0.0) {
        leave = -1.0;
      }
    };
    for (int n = 0; n < 3; ++n) {
      cut(weight[n], rate[n]);
      if (!(enter <= leave)) return until;
    }
    cut(1.0 - weight.sum(), -rate.sum());
    return enter <= leave ? enter : until;
  }

  const HapticSurface& surface_;
  const Vec3 &from_mm_, &to_mm_;
  const Vec3 way_mm_;
  const double bound_;
  ToolCellCache& cache_;
  int& work_;
  ChordHit hit_;
};

// Looks at the cells around a point.
class View {
 public:
  View(const HapticSurface& surface, const Vec3& p_mm, double reach_mm, ToolCellCache& cache,
       Surroundings& around, int& work)
      : surface_(surface),
        p_mm_(p_mm),
        reach2_(reach_mm * reach_mm),
        bound_(DensityBound(surface)),
        cache_(cache),
        around_(around),
        work_(work) {}

  void Run(double reach_mm) noexcept {
    around_.count = 0;
    around_.excess = -std::numeric_limits<double>::infinity();
    least_weight_ = -std::numeric_limits<double>::infinity();
    const Vec3 p = surface_.X_LD.Apply(p_mm_);
    const Vec3 reach = reach_mm * surface_.X_LD.linear.rowwise().norm();
    if (IsBeyondASide(surface_, p - reach, p + reach)) {
      if (!surface_.IsFreeOutside()) around_.excess = std::numeric_limits<double>::infinity();
      return;
    }
    const Vec3i first = (p - reach).array().floor().matrix().cast<int>();
    const Vec3i last = (p + reach).array().floor().matrix().cast<int>();
    middle_ = p.array().floor().matrix().cast<int>();
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        for (int z = first.z(); z <= last.z(); ++z) Visit({x, y, z});
      }
    }
    // In a free cell next to H, the density tells which side of a ridge is nearer.
    if (around_.count > 0 && std::isinf(around_.excess) && surface_.lattice.HasCell(middle_)) {
      VisitTetrahedra(cache_.Densities(surface_, middle_));
      around_.excess = std::min(around_.excess, 0.0);
    }
  }

 private:
  void Visit(const Vec3i& at) noexcept {
    ++work_;
    if (!surface_.lattice.HasCell(at)) {
      if (at == middle_ && !surface_.IsFreeOutside()) {
        around_.excess = std::numeric_limits<double>::infinity();
      }
      return;
    }
    HapticCell& cell = cache_.Densities(surface_, at);
    if (!cell.IsFree(surface_)) VisitTetrahedra(cell);
  }

  void VisitTetrahedra(HapticCell& cell) noexcept {
    cache_.Decompose(surface_, cell);
    const unsigned above = VerticesAbove(cell, bound_);
    for (int t = 0; t < cell.parts.complex.tetrahedron_count; ++t) {
      ++work_;
      VisitTetrahedron(cell, t, cell.cell == middle_,
                       (cell.parts.complex.vertex_mask[t] & above) == 0);
    }
  }

  void VisitTetrahedron(HapticCell& cell, int t, bool may_hold, bool is_free) noexcept {
    const int v = cell.parts.complex.vertices[t][0];
    const TetrahedronGradients gradients = cache_.Gradients(cell, t);
    const Vec3 from_base = p_mm_ - cell.origin_mm - cell.vertex_mm[v];
    double rest = 1.0, least = 1.0;
    bool is_far = false;
    const auto look = [&](double weight, const HalfSpace& inward) {
      least = std::min(least, weight);
      is_far = is_far || (weight < 0.0 && weight * weight > reach2_ * inward.normal2);
    };
    for (std::size_t n = 1; n < 4; ++n) {
      const double weight = gradients.weight[n].normal.dot(from_base);
      look(weight, gradients.weight[n]);
      if (is_far && !may_hold) return;
      rest -= weight;
    }
    look(rest, gradients.weight[0]);
    const HalfSpace& fall = gradients.fall;
    // One of the cell's holds the point, whatever rounding says.
    if (may_hold && least > least_weight_) {
      least_weight_ = least;
      around_.excess = cell.parts.density[v] - fall.normal.dot(from_base) - bound_;
    }
    if (is_far || is_free || !(fall.normal2 > 0.0) || around_.count >= Surroundings::kMost) return;
    around_.plane[static_cast<std::size_t>(around_.count++)] = PlaneOf(cell, t, fall, bound_);
  }

  const HapticSurface& surface_;
  const Vec3& p_mm_;
  const double reach2_;
  const double bound_;
  ToolCellCache& cache_;
  Surroundings& around_;
  int& work_;
  Vec3i middle_;
  double least_weight_;  // of the point in the tetrahedron that holds it best
};

}  // namespace

std::optional<ChordHit> FirstHit(const HapticSurface& surface, const Vec3& from_mm,
                                 const Vec3& to_mm, ToolCellCache& cache, int& work) noexcept {
  return Chord(surface, from_mm, to_mm, cache, work).Run();
}

int MostChordWork(const HapticSurface& surface, double way_mm) noexcept {
  const double cells = surface.X_LD.linear.rowwise().norm().sum() * way_mm + 4.0;
  return static_cast<int>(cells) * (1 + kMaxTetrahedra);
}

int MostLookWork(const HapticSurface& surface, double reach_mm) noexcept {
  const Vec3 reach = 2.0 * reach_mm * surface.X_LD.linear.rowwise().norm();
  // One more: the middle cell may be looked at twice.
  return static_cast<int>((reach.array().floor() + 2.0).prod() + 1.0) * (1 + kMaxTetrahedra);
}

void Look(const HapticSurface& surface, const Vec3& p_mm, double reach_mm, ToolCellCache& cache,
          Surroundings& around, int& work) noexcept {
  View(surface, p_mm, reach_mm, cache, around, work).Run(reach_mm);
}

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
