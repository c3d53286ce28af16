// The proxy SCP_H: a point that follows the stylus and never enters the object.
//
// Each step moves the proxy towards the HIP through the tetrahedra of the decomposed volume. For
// every tetrahedron and free cell that holds the proxy, HIP - SCP_H is projected on the cone of
// directions that stay inside of it. If the proxy rests on H, the cone is also limited to the free
// side of H. The proxy follows the longest projection to a face, to H, or to the projection's end,
// until no projection is left. This one rule gives free and constrained mode.
//
// Guarantees at every move of every step, whatever the HIP does:
// - the piecewise-linear density at SCP_H is within the bounds of the surface (no fall-through),
//   except while ejecting or buried;
// - each move starts in the tetrahedron or cell where the previous move ended, except for the jump
//   to a free voxel while ejecting;
// - a proxy at rest is a local minimum of its distance to the HIP;
// - the work is bounded; the next step continues the rest.
// If a change of τ or of the data puts the proxy beyond a bound, the proxy is ejecting: it moves
// out along the density gradient, or to the nearest free lattice vertex. If that is farther away
// than `eject_limit_mm`, the proxy is buried: no surface is felt until the HIP is in free space.
// Another loaded volume brings it out by at most a voxel, as much as another lattice of the same
// volume may need: nobody asked for a push where a hand happens to be.
//
// Frame: D device (mm) at the interface, cells in L.
// Threads: pure; one thread per state. Real-time: no allocation, no locks.
// Source: Corenthy et al., sections 4.1 and 4.2. Unlike there, the constraints of each tetrahedron
// are kept apart: taken together as half-spaces, they hold the proxy at convex edges where it
// should slide off.
#pragma once

#include <cstdint>

#include "common/contract/enumerations.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/place.h"

namespace palpate {

// The most moves per step, for each step of the refinement: so a way is as long for every one.
inline constexpr int kMaxProxyMoves = 512;

struct Proxy {
  bool placed = false;
  Contact contact = Contact::kNone;
  bool buried = false;
  Place place;
  Vec3 p_DH_mm = Vec3::Zero();
  // The surface to which `place` refers.
  std::uint64_t geometry_revision = 0;
  int refinement = 1;
  std::uint64_t volume_revision = 0;
  std::uint64_t loaded_revision = 0;
  FreeSide free_side = FreeSide::kBelow;
  double isovalue = 0.0;
  double lower = -kUnbounded;

  bool on_surface() const { return contact != Contact::kNone; }
};

struct ProxyStep {
  Vec3 p_DH_mm = Vec3::Zero();   // SCP_H
  Vec3 normal_D = Vec3::Zero();  // of H at SCP_H towards free space, unit; zero without contact.
                                 // On an edge or vertex of H: the direction it pushes in.
  ProxyMode mode = ProxyMode::kFree;
  double density = 0.0;  // normalised, not felt; trilinear in a cell that τ does not cross
  int moves = 0;
  int tetrahedra = 0;   // examined tangent cones
  bool capped = false;  // the limit on moves was reached, or rounding allowed no further move
};

// Makes one step towards p_DHip_mm (finite; a copy, which may be the proxy's own position). `cache`
// holds no state of its own.
ProxyStep StepProxy(const HapticSurface& surface, Vec3 p_DHip_mm, double eject_limit_mm,
                    Proxy& proxy, CellCache& cache) noexcept;

// For a proxy that was read and not computed: returns true if a step may start from its place.
// Returns false if the surface's cells have no such place.
bool Fits(const HapticSurface& surface, const Proxy& proxy, CellCache& cache) noexcept;

// Moves the proxy from free space straight towards the HIP, to the point where that line meets H,
// without sliding. Adds its work to `step`, and sets the position and density there. The proxy must
// refer to `surface` already.
void DropToSurface(const HapticSurface& surface, Vec3 p_DHip_mm, Proxy& proxy, CellCache& cache,
                   ProxyStep& step) noexcept;

// The part of HIP - SCP_H that nothing blocks: 0 at rest, all of it in free space. The rest of HIP
// - SCP_H is held by H, and normal to H.
Vec3 FreePart(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
              CellCache& cache) noexcept;

// Checks that a proxy at rest is a local minimum, for tests, and to show that an unexpectedly large
// force comes from the surface. Returns the greatest possible approach to the HIP per length: 0 at
// a minimum, 1 in free space.
double RestResidual(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
                    CellCache& cache) noexcept;

}  // namespace palpate
