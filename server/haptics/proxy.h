// The proxy SCP_H: a point that follows the stylus and never enters the object.
//
// Each step moves the proxy towards the HIP through the tetrahedra of the
// decomposed volume. In every tetrahedron and free cell that holds the proxy,
// HIP - SCP_H is projected on the cone of directions that stay inside it and,
// where the proxy rests on H, on the free side of H; the longest projection is
// followed to a face, to H, or to its end, until no projection is left. Free
// and constrained mode are this one rule.
//
// Holds at every move of every step, whatever the HIP does:
// - the piecewise-linear density at SCP_H is at most τ (no fall-through), but
//   while ejecting;
// - each move starts in the tetrahedron or cell where the last one ended, but for
//   the jump to a free lattice vertex while ejecting;
// - a proxy that rests is a local minimum of its distance to the HIP;
// - the work is bounded; what the bound leaves over is done in the next step.
// When τ or the data change so that the proxy is inside the object, it is
// ejecting: moved out down the density gradient, or to the nearest free lattice
// vertex. Where that is farther than `eject_limit_mm`, it is buried: no surface
// is felt until the HIP is in free space.
//
// Frame: D device (mm) at the interface, cells in index coordinates.
// Threads: pure; one thread per state. Real-time: no allocation, no locks.
// Source: Corenthy et al., sections 4.1 and 4.2, with the constraints of each
// tetrahedron kept apart: taken together as half-spaces they hold the proxy at
// convex edges where it should slide off.
#pragma once

#include <cstdint>

#include "server/haptics/haptic_surface.h"
#include "server/haptics/place.h"

namespace palpate {

// kFault: buried for longer than kMaxEjectSteps; ends as kEjecting does.
enum class ProxyMode : std::uint8_t { kFree, kConstrained, kEjecting, kFault };

inline constexpr int kMaxEjectSteps = 50;

// Moves per step at most.
inline constexpr int kMaxProxyMoves = 512;

struct Proxy {
  bool placed = false;
  bool on_surface = false;
  bool buried = false;
  int buried_steps = 0;
  Place place;
  Vec3 p_DH_mm = Vec3::Zero();
  // Of the surface that `place` refers to.
  std::uint64_t geometry_revision = 0;
  std::uint64_t volume_revision = 0;
  FreeSide free_side = FreeSide::kBelow;
  double isovalue = 0.0;
};

struct ProxyStep {
  Vec3 p_DH_mm = Vec3::Zero();   // SCP_H
  Vec3 normal_D = Vec3::Zero();  // of H at SCP_H towards free space, unit; zero without contact.
                                 // On an edge or vertex of H: the direction it pushes in.
  ProxyMode mode = ProxyMode::kFree;
  double density = 0.0;  // normalised, not felt; trilinear in a cell that τ does not cross
  int moves = 0;
  int tetrahedra = 0;   // tangent cones looked at
  bool capped = false;  // the bound on moves bit, or rounding allowed no further move
};

// One step towards p_DHip_mm (finite). `cache` holds no state of its own.
ProxyStep StepProxy(const HapticSurface& surface, const Vec3& p_DHip_mm, double eject_limit_mm,
                    Proxy& proxy, CellCache& cache) noexcept;

// Of a proxy that was not computed here but read: whether a step may take its place as
// it is. False where the surface's cells have no such place.
bool Fits(const HapticSurface& surface, const Proxy& proxy, CellCache& cache) noexcept;

// From free space straight towards the HIP, to where the way there meets H: no
// sliding. Adds its work to `step`. The proxy refers to `surface` already.
void DropToSurface(const HapticSurface& surface, const Vec3& p_DHip_mm, Proxy& proxy,
                   CellCache& cache, ProxyStep& step) noexcept;

// The part of HIP - SCP_H that nothing stands in the way of: 0 at rest, all of it in
// free space. What is left of HIP - SCP_H is held by H, and normal to it.
Vec3 FreePart(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
              CellCache& cache) noexcept;

// Whether a proxy at rest is a local minimum: for tests, and for showing that a
// force above the expected one is due to the surface. Returns the greatest
// approach to the HIP per length still possible, 0 at a minimum, 1 in free space.
double RestResidual(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
                    CellCache& cache) noexcept;

}  // namespace palpate
