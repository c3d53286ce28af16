#include "server/haptics/proxy.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "server/haptics/moves.h"

namespace palpate {
namespace {

constexpr int kMaxEjectMoves = 128;
constexpr int kMaxSearchRadius = 6;  // voxels

// With uneven voxels, a vertex of a farther shell can be nearer. The search ends when a whole shell
// is farther away than the best vertex.
bool JumpToNearestVertex(const HapticSurface& surface, double limit_mm, Place& place,
                         CellCache& cache) noexcept {
  double best_mm = std::numeric_limits<double>::infinity();
  Vec3i best = Vec3i::Zero();
  // The least distance between neighbouring planes of voxels. The place is up to a cell away from
  // the middle of the shells.
  const double plane_mm = 1.0 / surface.X_ID.linear.rowwise().norm().maxCoeff();
  const Lattice& lattice = surface.lattice;
  const Vec3 from_I = lattice.ToVoxels(PlaceLatticePosition(surface, place, cache));
  const Vec3i middle = lattice.PartOf(place.cell).voxel_cell;
  for (int radius = 0; radius <= kMaxSearchRadius; ++radius) {
    if ((radius - 1) * plane_mm > std::min(best_mm, limit_mm)) break;
    VisitShell(middle, radius, [&](const Vec3i& voxel) {
      if (!surface.Holds(surface.ResolvedVertex(voxel))) return;
      const Vec3 away = surface.X_DI.linear * (voxel.cast<double>() - from_I);
      if (away.norm() < best_mm) best_mm = away.norm(), best = voxel;
    });
  }
  if (!std::isfinite(best_mm)) return false;
  double density = 0.0;
  place = PlaceAt(surface, lattice.FromVoxels(best.cast<double>()), cache, density);
  return true;
}

// Brings a point back into free space when the surface has moved over it.
//
// Threads: pure. Real-time: no allocation; at most kMaxEjectMoves moves for each
// step of the refinement, and kMaxSearchRadius shells of voxels.
//
// Moves `place`, whose density is not that of free space, to free space. Descends the
// piecewise-linear density to the upper bound, or ascends it to the lower one. From a pit or a peak
// beyond the bound, jumps to the nearest free voxel within `limit_mm`.
// Returns false if there is none within reach; `place` is then unspecified. Sets `contact`. Adds
// the number of moves to `moves`.
bool Eject(const HapticSurface& surface, double limit_mm, Place& place, Contact& contact,
           CellCache& cache, int& moves) noexcept {
  contact = Contact::kNone;
  // A place outside of the lattice has no density to descend.
  if (place.kind == Place::Kind::kOutside) return surface.IsFreeOutside();
  const bool is_above = PlaceDensity(surface, place, cache) > surface.isovalue;
  const Contact out_to = is_above ? Contact::kUpper : Contact::kLower;
  for (int n = 0; n < kMaxEjectMoves * surface.lattice.refinement(); ++n) {
    const Candidate way = SteepestWay(surface, place, out_to, cache);
    if (way.kind == Candidate::Kind::kNone) break;
    MoveInTetrahedron(surface, way, out_to, place, contact, cache);
    ++moves;
    // Also set if rounding stopped the move before the surface; the density tells.
    if (contact != Contact::kNone) break;
  }
  if (surface.Holds(PlaceDensity(surface, place, cache))) return true;
  contact = Contact::kNone;
  return JumpToNearestVertex(surface, limit_mm, place, cache);
}

// A remaining projection shorter than this share of HIP - SCP_H is rounding.
constexpr double kRestTolerance = 1e-8;
// So is a remaining projection shorter than this share of a voxel: more than what Place sets to 0.
constexpr double kRestTolerancePerVoxel = 1e-11;

bool IsAtRest(const HapticSurface& surface, const Vec3& d_mm, const Vec3& w_mm) {
  return d_mm.norm() <=
         std::max(kRestTolerance * w_mm.norm(), kRestTolerancePerVoxel * surface.longest_voxel_mm);
}

// Puts the proxy at p_D. Returns false if p_D is not in free space and there is no free space
// within eject_limit_mm.
bool PutAt(const HapticSurface& surface, const Vec3& p_D, double eject_limit_mm, Proxy& proxy,
           CellCache& cache, ProxyStep& step) noexcept {
  double density = 0.0;
  proxy.place = PlaceAt(surface, surface.X_LD.Apply(p_D), cache, density);
  proxy.contact = Contact::kNone;
  if (surface.Holds(density)) return true;
  step.mode = ProxyMode::kEjecting;
  return Eject(surface, eject_limit_mm, proxy.place, proxy.contact, cache, step.moves) &&
         (PlacePosition(surface, proxy.place, cache) - p_D).norm() <= eject_limit_mm;
}

void SetSurface(const HapticSurface& surface, Proxy& proxy) {
  proxy.placed = true;
  proxy.geometry_revision = surface.geometry_revision;
  proxy.refinement = surface.lattice.refinement();
  proxy.volume_revision = surface.volume->revision();
  proxy.loaded_revision = surface.volume->loaded_revision();
  proxy.free_side = surface.free_side;
  proxy.isovalue = surface.isovalue;
  proxy.lower = surface.lower;
}

// The density as samples report it.
double ReportedDensity(const HapticSurface& surface, const Place& place, double felt) {
  return place.kind == Place::Kind::kOutside ? 0.0 : surface.sign() * felt;
}

// True if the place still means the same point with the same density, because its cell is
// unchanged.
bool Holds(const HapticSurface& surface, const Proxy& proxy) noexcept {
  if (!proxy.placed || proxy.geometry_revision != surface.geometry_revision ||
      proxy.refinement != surface.lattice.refinement()) {
    return false;
  }
  return proxy.volume_revision == surface.volume->revision() ||
         proxy.place.kind == Place::Kind::kOutside ||
         surface.lattice.CellRevision(proxy.place.cell) <= proxy.volume_revision;
}

bool HasBoundsOf(const HapticSurface& surface, const Proxy& proxy) noexcept {
  return proxy.isovalue == surface.isovalue && proxy.lower == surface.lower &&
         proxy.free_side == surface.free_side;
}

// Brings the proxy to the surface of this step. Returns false if the proxy is buried.
bool Refresh(const HapticSurface& surface, const Vec3& p_DHip_mm, double eject_limit_mm,
             Proxy& proxy, CellCache& cache, ProxyStep& step) noexcept {
  const bool same_geometry = Holds(surface, proxy);
  if (same_geometry && HasBoundsOf(surface, proxy)) {
    proxy.volume_revision = surface.volume->revision();
    return true;
  }
  // A cell that τ does not cross on one side is not crossed on the other side either.
  const bool simplex_holds = same_geometry && proxy.place.kind == Place::Kind::kSimplex;
  const Vec3 from = proxy.placed ? proxy.p_DH_mm : p_DHip_mm;
  SetSurface(surface, proxy);
  // Only the bounds or the side changed: the simplex still holds the proxy, to the last bit.
  if (simplex_holds) {
    proxy.contact = Contact::kNone;
    if (surface.Holds(PlaceDensity(surface, proxy.place, cache))) return true;
    step.mode = ProxyMode::kEjecting;
    return Eject(surface, eject_limit_mm, proxy.place, proxy.contact, cache, step.moves) &&
           (PlacePosition(surface, proxy.place, cache) - from).norm() <= eject_limit_mm;
  }
  return PutAt(surface, from, eject_limit_mm, proxy, cache, step);
}

// While buried, nothing is felt until the HIP itself is in free space.
ProxyStep StepBuried(const HapticSurface& surface, const Vec3& p_DHip_mm, Proxy& proxy,
                     CellCache& cache) noexcept {
  ProxyStep step;
  SetSurface(surface, proxy);
  double density = 0.0;
  proxy.place = PlaceAt(surface, surface.X_LD.Apply(p_DHip_mm), cache, density);
  proxy.contact = Contact::kNone;
  proxy.p_DH_mm = step.p_DH_mm = p_DHip_mm;
  step.density = ReportedDensity(surface, proxy.place, density);
  proxy.buried = !surface.Holds(density);
  if (proxy.buried) step.mode = ProxyMode::kInside;
  return step;
}

// Moves the proxy until it is at rest or out of moves. With `stops_on_surface`, also stops on H.
// Flat, and it holds the cell of a move for the next: calls and look-ups at every move would cost a
// tenth of the tick.
[[gnu::flatten]] void Advance(const HapticSurface& surface, const Vec3& p_DHip_mm,
                              bool stops_on_surface, Proxy& proxy, CellCache& cache,
                              ProxyStep& step) noexcept {
  const Vec3 p_LHip = surface.X_LD.Apply(p_DHip_mm);
  const int most_moves = kMaxProxyMoves * surface.lattice.refinement();
  HapticCell* held = nullptr;
  const auto hold = [&](HapticCell* cell) {
    held = cell;
    proxy.p_DH_mm =
        cell ? PositionIn(*cell, proxy.place.carrier) : surface.X_DL.Apply(proxy.place.p_L);
  };
  const bool in_simplex = proxy.place.kind == Place::Kind::kSimplex;
  hold(in_simplex ? &cache.Decomposed(surface, proxy.place.cell) : nullptr);
  while (!(stops_on_surface && proxy.on_surface())) {
    if (step.moves >= most_moves) {
      step.capped = true;
      return;
    }
    if (proxy.place.kind == Place::Kind::kOutside) {
      MoveOutside(surface, p_LHip, proxy.place);
      ++step.moves;
      hold(nullptr);
      if (proxy.place.kind == Place::Kind::kOutside) return;
      continue;
    }
    const Vec3 w_mm = p_DHip_mm - proxy.p_DH_mm;
    const Candidate best =
        BestDirection(surface, proxy.place, held, proxy.contact, w_mm, cache, step.tetrahedra);
    if (best.kind == Candidate::Kind::kNone || IsAtRest(surface, best.d_mm, w_mm)) return;
    ++step.moves;
    switch (best.kind) {
      case Candidate::Kind::kOutside:
        MoveOut(surface, best, p_LHip, proxy.place);
        proxy.contact = Contact::kNone;
        hold(nullptr);
        return;
      case Candidate::Kind::kBox:
        MoveInBox(surface, best, proxy.place, cache);
        proxy.contact = Contact::kNone;
        hold(nullptr);
        break;
      case Candidate::Kind::kTetrahedron: {
        const MoveEnd end =
            MoveInTetrahedron(surface, best, Contact::kNone, proxy.place, proxy.contact, cache);
        hold(best.entry);
        step.capped = end == MoveEnd::kNone;
        if (end != MoveEnd::kMore) return;
        break;
      }
      case Candidate::Kind::kNone:
        break;
    }
  }
}

// The normal of H's facet at a proxy that rests on it without load.
Vec3 FacetNormal(const HapticSurface& surface, const Proxy& proxy, CellCache& cache) noexcept {
  HapticCell& cell = cache.Decomposed(surface, proxy.place.cell);
  for (std::uint32_t left = TetrahedraAt(cell.parts.complex, proxy.place.carrier); left;
       left &= left - 1) {
    const Vec3& fall = cache.Gradients(cell, std::countr_zero(left)).fall.normal;
    if (fall.isZero(0.0)) continue;
    return proxy.contact == Contact::kLower ? Vec3(-fall.normalized()) : fall.normalized();
  }
  return Vec3::Zero();
}

}  // namespace

ProxyStep StepProxy(const HapticSurface& surface, Vec3 p_DHip_mm, double eject_limit_mm,
                    Proxy& proxy, CellCache& cache) noexcept {
  if (proxy.buried) return StepBuried(surface, p_DHip_mm, proxy, cache);
  ProxyStep step;
  const bool is_other_volume =
      proxy.placed && proxy.loaded_revision != surface.volume->loaded_revision();
  const double limit_mm =
      is_other_volume ? std::min(eject_limit_mm, surface.longest_voxel_mm) : eject_limit_mm;
  if (!Refresh(surface, p_DHip_mm, limit_mm, proxy, cache, step)) {
    proxy.buried = true;
    return StepBuried(surface, p_DHip_mm, proxy, cache);
  }
  Advance(surface, p_DHip_mm, false, proxy, cache, step);
  step.p_DH_mm = proxy.p_DH_mm;
  step.density = ReportedDensity(surface, proxy.place, PlaceDensity(surface, proxy.place, cache));
  if (proxy.on_surface()) {
    const Vec3 push = step.p_DH_mm - p_DHip_mm;
    step.normal_D = push.norm() > kRestTolerancePerVoxel * surface.voxel_mm
                        ? push.normalized()
                        : FacetNormal(surface, proxy, cache);
    if (step.mode == ProxyMode::kFree) step.mode = ProxyMode::kConstrained;
  }
  return step;
}

bool Fits(const HapticSurface& surface, const Proxy& proxy, CellCache& cache) noexcept {
  const Place& place = proxy.place;
  // A place that no longer holds is found anew.
  if (!Holds(surface, proxy) || place.kind == Place::Kind::kOutside) return true;
  if (!surface.lattice.HasCell(place.cell)) return false;
  if (place.kind == Place::Kind::kBox) return true;
  const TetrahedralComplex& complex = cache.Decomposed(surface, place.cell).parts.complex;
  const std::uint32_t tetrahedra = TetrahedraAt(complex, place.carrier);
  return place.tetrahedron < 0 ? tetrahedra != 0 : (tetrahedra >> place.tetrahedron & 1) != 0;
}

void DropToSurface(const HapticSurface& surface, Vec3 p_DHip_mm, Proxy& proxy, CellCache& cache,
                   ProxyStep& step) noexcept {
  Advance(surface, p_DHip_mm, true, proxy, cache, step);
  step.p_DH_mm = proxy.p_DH_mm;
  step.density = ReportedDensity(surface, proxy.place, PlaceDensity(surface, proxy.place, cache));
}

Vec3 FreePart(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
              CellCache& cache) noexcept {
  if (proxy.place.kind == Place::Kind::kOutside) return Vec3::Zero();
  const Vec3 w_mm = p_DHip_mm - PlacePosition(surface, proxy.place, cache);
  int tetrahedra = 0;
  return BestDirection(surface, proxy.place, nullptr, proxy.contact, w_mm, cache, tetrahedra).d_mm;
}

double RestResidual(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
                    CellCache& cache) noexcept {
  const double way_mm = (p_DHip_mm - PlacePosition(surface, proxy.place, cache)).norm();
  if (!(way_mm > 0.0)) return 0.0;
  return FreePart(surface, p_DHip_mm, proxy, cache).norm() / way_mm;
}

}  // namespace palpate
