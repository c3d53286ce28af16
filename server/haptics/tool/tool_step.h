// The tool as it is felt: a rigid body that follows the stylus and of which no ball enters the
// object.
//
// The state is one pose. A step takes the tool from one rigid pose to the next; in between, the
// centre of each ball goes along its own straight chord. A pose is taken only if no chord leaves
// free space. (Between the poses the tool's shape is not kept: it shrinks by the square of the turn
// over 8.) So no centre ever crosses H, whatever the hand does.
//
// The metric is the coupling's own: a move is as long as (way, ρ turn). A tool at rest is a local
// minimum of the coupling's energy k / 2 |(way, ρ turn)|² to the stylus's pose. So force k way and
// torque k ρ² turn are those of the contacts, and do no work but the spring's.
//
// Each round of a step:
// 1. Every ball near H gets a half-space: the plane of the tetrahedron that holds it, kept off by
//    a standoff. More planes are those of tetrahedra within a few standoffs, and those that chords
//    have met in this step, as long as they do not overestimate the density where the ball is: so
//    both sides of a crease hold a ball, and only one side of a ridge.
// 2. The move nearest to the wanted one in these half-spaces (least_move.h).
// 3. Chords. A hit gives a new plane; the move ends before it, or is looked for again.
// 4. At rest, each ball that holds the tool tries the planes beyond the ridges around it, alone.
//
// Frame: D (mm). Threads: pure; one thread per state. Real-time: no allocation, no locks; the work
// is bounded by what the caller gives, and the next step goes on.
// Source: constraint-based rendering as M. Ortega, S. Redon, S. Coquillart, IEEE TVCG 13, 2007, on
// the tetrahedra of Corenthy et al.; the rounds are ours.
#pragma once

#include <cstdint>

#include "common/contract/enumerations.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/tool/rigid_tool.h"

namespace palpate {

class ToolCellCache;

inline constexpr int kMostToolRounds = 64;

// Borrowed. One surface and one cache for each radius of the tool.
struct ToolSurfaces {
  std::array<const HapticSurface*, kMostToolRadii> surface{};
  std::array<ToolCellCache*, kMostToolRadii> cache{};
};

struct ToolState {
  bool placed = false;
  bool buried = false;  // nothing is felt until the tool is free where the stylus is
  ToolPose pose;
  int stalled_steps = 0;    // that were capped before the tool could move
  int ejecting_steps = 0;   // that have not brought it out yet
  double ejected_mm = 0.0;  // by these, in the metric of the coupling
  std::uint64_t loaded_revision = 0;
};

struct ToolStep {
  ToolPose pose;
  ProxyMode mode = ProxyMode::kFree;
  std::uint64_t touching = 0;  // bit n: ball n holds the tool back
  double slope_per_mm = 0.0;   // the least of the density where it does
  int rounds = 0;
  int work = 0;         // cells and tetrahedra looked at, and what planes cost
  bool capped = false;  // the work was not enough
};

// The poses that the tool took in a step, for judges: between two of them, each ball's centre goes
// straight. A round that goes over a ridge has two.
struct ToolPath {
  std::array<ToolPose, 2 * kMostToolRounds> pose;
  int count = 0;
};

// The least `work` of a step: every ball is looked at once.
inline constexpr int kLeastToolWork = 18'000;

// `eject_limit_mm`: in the metric of the coupling, the farthest that a tool is moved that an edit
// or another isovalue put into the object; else it is buried. `work`: the most that a step does.
ToolStep StepTool(const RigidTool& tool, const ToolSurfaces& surfaces, const ToolPose& stylus,
                  double eject_limit_mm, int work, ToolState& state,
                  ToolPath* path = nullptr) noexcept;

}  // namespace palpate
