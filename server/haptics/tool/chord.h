// Straight ways of single points through the tetrahedra of a volume, and the planes of H around
// them.
//
// A point here is a position, without a combinatorial place (place.h): the rounded poses of a rigid
// tool cannot put several points on planes exactly. So a point keeps kDensityMargin of density away
// from τ, which is more than what any rounding of the same position changes.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation; bounded by the work counted.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>

#include "server/haptics/cell_cache.h"
#include "server/haptics/tool/least_move.h"
#include "server/haptics/tool/rigid_tool.h"

namespace palpate {

// Positions within a metre of the origin; steeper than 10 of the range in a millimetre, nothing is.
inline constexpr double kDensityMargin = 1e-11;

inline double DensityBound(const HapticSurface& surface) {
  return surface.isovalue - kDensityMargin;
}

// H in a tetrahedron, extended to a plane.
struct SurfacePlane {
  Vec3 normal_D;     // towards free space, unit
  double offset_mm;  // normal_D · p of all p of the plane
  double slope;      // of the density, per mm

  double Gap(const Vec3& p_mm) const { return normal_D.dot(p_mm) - offset_mm; }
  // The density of the tetrahedron's gradient there, less the bound.
  double Excess(const Vec3& p_mm) const { return -slope * Gap(p_mm); }

  bool operator==(const SurfacePlane&) const = default;
};

struct ChordHit {
  double share = 1.0;                 // of the chord, before which it is free
  std::optional<SurfacePlane> plane;  // none: of no single tetrahedron
};

// The first point where a chord that begins in free space leaves it. `work` counts the cells and
// tetrahedra that were looked at.
std::optional<ChordHit> FirstHit(const HapticSurface& surface, const Vec3& from_mm,
                                 const Vec3& to_mm, ToolCellCache& cache, int& work) noexcept;

// What is around a point.
struct Surroundings {
  static constexpr int kMost = 48;

  // The density at the point, less the bound; minus infinity in a free cell without planes near.
  double excess = 0.0;
  // Those of the tetrahedra within reach that H may cross, or that are all beyond it.
  std::array<SurfacePlane, kMost> plane;
  int count = 0;
};

// The most work of FirstHit for so long a chord, and of Look.
int MostChordWork(const HapticSurface& surface, double way_mm) noexcept;
int MostLookWork(const HapticSurface& surface, double reach_mm) noexcept;

void Look(const HapticSurface& surface, const Vec3& p_mm, double reach_mm, ToolCellCache& cache,
          Surroundings& around, int& work) noexcept;

inline constexpr int kMostBallPlanes = 256;
// So near to H a ball may come on its way over a ridge, in standoffs.
inline constexpr double kThinStandoffs = 0.1;

struct BallPlane {
  int ball = 0;
  SurfacePlane plane;

  bool operator==(const BallPlane&) const = default;
};

// What does not fit is left out.
template <class T, int kMost>
struct List {
  std::array<T, kMost> item;
  int count = 0;

  void Add(const T& added) {
    if (count < kMost) item[static_cast<std::size_t>(count++)] = added;
  }
  std::span<const T> all() const { return {item.data(), static_cast<std::size_t>(count)}; }
};

// The balls of a tool at a pose.
struct PlacedBalls {
  std::array<Vec3, kMostToolBalls> arm_mm;  // from the tool's origin
  std::array<Vec3, kMostToolBalls> p_mm;
  std::array<double, kMostToolBalls> excess{};  // of the density; see Surroundings
};

// How the planes limit a move.
enum class Limits : std::uint8_t {
  kKeep,     // no ball comes nearer than its standoff, or than it is
  kRestore,  // every ball gets its standoff back
  kAcross,   // one ball may come as near as kThinStandoffs, and holds the plane beyond a ridge, too
  kBeyond,   // it holds only that
};

struct HeldMove {
  Vec6 x = Vec6::Zero();
  std::uint64_t active = 0;  // bit n: ball n holds the tool back
  int active_count = 0;      // planes that do
  double slope_per_mm = std::numeric_limits<double>::infinity();  // the least of theirs
};

// The planes that hold the balls of a tool at a pose, and the nearest move in them.
//
// A plane counts as long as it does not overestimate the density where its ball is: so both sides
// of a crease hold a ball, and only one side of a ridge.
//
// Frame: D (mm), moves in the metric of the coupling (tool_step.h). Threads: pure. Real-time: no
// allocation; the work is bounded by what the caller gives.
class BallPlanes {
 public:
  // Borrows `balls`.
  BallPlanes(const PlacedBalls& balls, double standoff_mm, double rotation_length_mm)
      : balls_(balls), standoff_mm_(standoff_mm), rho_mm_(rotation_length_mm) {}

  bool Holds(const BallPlane& plane) const;
  // Of the last Solve.
  bool Knows(const BallPlane& plane) const;

  // At another pose: those near the balls come anew, and of those kept, what holds stays.
  void ForgetNear() { near_.count = 0; }
  void AddNear(const BallPlane& plane);
  void DropKept();
  // One that a chord has met. It limits the next move, also where it does not hold yet.
  void Keep(const BallPlane& plane);
  void ForgetKept() { kept_.count = 0; }
  std::span<const BallPlane> kept() const { return kept_.all(); }

  // The nearest move to the wanted one; none, if nothing moves. `beyond`: the planes beyond a
  // ridge, of one ball. Adds to `work` at most `most_work`. `capped`: that was not enough.
  HeldMove Solve(const Vec6& wanted, Limits limits, std::span<const BallPlane> beyond,
                 int most_work, int& work, bool& capped) noexcept;

 private:
  void Hold(std::span<const BallPlane> planes, int but_of);
  LeastMove Nearest(const Vec6& wanted, Limits limits, int thin_ball, int most_work, int& work,
                    bool& capped) noexcept;

  const PlacedBalls& balls_;
  const double standoff_mm_, rho_mm_;
  List<BallPlane, kMostBallPlanes> near_;  // of the tetrahedra around the balls
  List<BallPlane, kMostBallPlanes> kept_;  // of those that chords have met
  List<BallPlane, kMostBallPlanes> held_;  // those that limit the move
  std::array<MoveLimit, kMostBallPlanes> limits_;
};

}  // namespace palpate
