#include "server/haptics/moves.h"

#include <bit>
#include <cmath>

namespace palpate {
namespace {

// A slope counts as steeper only beyond this factor, so that rounding does not choose.
constexpr double kSteeper = 1.0 + 1e-12;
// A pull leads clearly out of a triangle's plane beyond this share of its length (both squared).
constexpr double kClearOfTriangle2 = 1e-8;
// In a pit, a slope below this share of the gradient is rounding.
constexpr double kNoSlope = 1e-9;

// The half-spaces of the cell's faces that hold the point, with inward normals in D.
Cone BoxCone(const HapticSurface& surface, std::uint8_t faces) {
  Cone cone;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 normal = surface.X_LD.linear.row(axis);
    if (faces >> (2 * axis) & 1) cone.Add(HalfSpace(normal));
    if (faces >> (2 * axis + 1) & 1) cone.Add(HalfSpace(-normal));
  }
  return cone;
}

// Returns the place as a simplex of the cell at `offset`.
Carrier CarrierIn(const HapticCell& cell, const Place& place, const Vec3i& offset,
                  std::uint8_t faces) {
  if (place.kind == Place::Kind::kSimplex) return CarrierInNeighbour(place.carrier, offset);
  return Locate(cell, place.p_L - cell.cell.cast<double>(), faces);
}

// Whether a move across H's level sets crosses the bound. `along`: its product with `fall`, minus
// the gradient of the density.
bool Crosses(Contact contact, double along) {
  return contact == Contact::kUpper ? along < 0.0 : contact == Contact::kLower && along > 0.0;
}

// The half-space on the free side of a bound.
HalfSpace FreeSideOf(const HalfSpace& fall, Contact bound) {
  HalfSpace free = fall;
  if (bound == Contact::kLower) free.normal = -fall.normal;
  return free;
}

struct TetrahedronCone {
  Cone cone;
  int surface_number = -1;  // number of the half-space under H
};

TetrahedronCone MakeTetrahedronCone(const HapticCell& cell, int tetrahedron, std::uint16_t mask,
                                    const TetrahedronGradients& gradients, Contact contact) {
  TetrahedronCone result;
  const auto& vertices = cell.parts.complex.vertices[tetrahedron];
  for (int n = 0; n < 4; ++n) {
    if (!(mask >> vertices[n] & 1)) result.cone.Add(gradients.weight[n]);
  }
  if (contact != Contact::kNone) {
    result.surface_number = result.cone.Add(FreeSideOf(gradients.fall, contact));
  }
  return result;
}

// Inside a tetrahedron, only H limits the direction.
void SetDirectionInside(HapticCell& cell, const Place& place, Contact contact, const Vec3& w_mm,
                        CellCache& cache, Candidate& best) noexcept {
  const auto& [fall, fall2] = cache.Gradients(cell, place.tetrahedron).fall;
  const double along = fall.dot(w_mm);
  best.kind = Candidate::Kind::kTetrahedron;
  best.cell = place.cell;
  best.entry = &cell;
  best.carrier = place.carrier;
  best.tetrahedron = place.tetrahedron;
  best.d_mm = w_mm;
  best.along_surface = Crosses(contact, along);
  best.full = !best.along_surface;
  if (!best.full) best.d_mm -= (along / fall2) * fall;
}

// Visits the cells that hold a place, one by one, and keeps the longest projection.
class DirectionSearch {
 public:
  DirectionSearch(const HapticSurface& surface, const Place& place, Contact contact,
                  const Vec3& w_mm, CellCache& cache, int& tetrahedra, Candidate& best)
      : surface_(surface),
        place_(place),
        contact_(contact),
        w_mm_(w_mm),
        cache_(cache),
        tetrahedra_(tetrahedra),
        best_(best) {}

  void Visit(const Vec3i& offset) noexcept {
    if (best_.full) return;
    const Vec3i cell = place_.cell + offset;
    const std::uint8_t faces = FacesInNeighbour(place_.faces, offset);
    if (!surface_.lattice.HasCell(cell)) return VisitOutside(cell, faces);
    HapticCell& entry = cache_.Densities(surface_, cell);
    if (entry.IsFree(surface_)) return VisitFreeCell(entry, faces);
    if (!entry.IsCrossed(surface_)) return;
    cache_.Decompose(surface_, entry);
    VisitTetrahedra(entry, CarrierIn(entry, place_, offset, faces), faces);
  }

 private:
  // The outside is free, and convex here: a direction out of the lattice is taken whole. A
  // projection on the apex is no direction and has no active face.
  void VisitOutside(const Vec3i& cell, std::uint8_t faces) noexcept {
    if (!surface_.IsFreeOutside()) return;
    if (ProjectOnCone(w_mm_, BoxCone(surface_, faces)).d != w_mm_) return;
    best_.d_mm = w_mm_;
    Take(Candidate::Kind::kOutside, cell, faces, true);
  }

  void VisitFreeCell(HapticCell& cell, std::uint8_t faces) noexcept {
    const ConeProjection projection = ProjectOnCone(w_mm_, BoxCone(surface_, faces), best_2_);
    if (!IsLonger(projection.d)) return;
    Take(Candidate::Kind::kBox, cell.cell, faces, projection.active == 0);
    best_.entry = &cell;
  }

  void VisitTetrahedra(HapticCell& cell, const Carrier& carrier, std::uint8_t faces) noexcept {
    const std::uint16_t mask = carrier.Mask();
    int longest = -1;
    for (std::uint32_t left = TetrahedraAt(cell.parts.complex, carrier); left && !best_.full;
         left &= left - 1) {
      const int t = std::countr_zero(left);
      ++tetrahedra_;
      const TetrahedronCone tangent =
          MakeTetrahedronCone(cell, t, mask, cache_.Gradients(cell, t), contact_);
      const ConeProjection projection = ProjectOnCone(w_mm_, tangent.cone, best_2_);
      if (!IsLonger(projection.d)) continue;
      longest = t;
      best_.full = projection.active == 0;
      best_.along_surface =
          tangent.surface_number >= 0 && (projection.active >> tangent.surface_number & 1);
    }
    if (longest < 0) return;
    best_.kind = Candidate::Kind::kTetrahedron;
    best_.cell = cell.cell;
    best_.entry = &cell;
    best_.faces = faces;
    best_.carrier = carrier;
    best_.tetrahedron = longest;
  }

  // Keeps `d` if it is longer than the best so far.
  bool IsLonger(const Vec3& d) noexcept {
    const double length2 = d.squaredNorm();
    if (!(length2 > best_2_)) return false;
    best_.d_mm = d;
    best_2_ = length2;
    return true;
  }

  void Take(Candidate::Kind kind, const Vec3i& cell, std::uint8_t faces, bool full) noexcept {
    best_.kind = kind;
    best_.cell = cell;
    best_.faces = faces;
    best_.full = full;
    best_.along_surface = false;
  }

  const HapticSurface& surface_;
  const Place& place_;
  const Contact contact_;
  const Vec3& w_mm_;
  CellCache& cache_;
  int& tetrahedra_;
  Candidate& best_;
  double best_2_ = 0.0;  // |best_.d_mm|²
};

// One of the two tetrahedra at the triangle that holds a point, and where the pull leads there if
// the triangle does not limit it.
struct Flank {
  HapticCell* cell;
  const Carrier* triangle;  // with the vertex numbers of `cell`
  std::uint8_t faces;
  int tetrahedron;
  const HalfSpace* inward;  // behind the triangle
  const HalfSpace* fall;    // towards lower densities
  Vec3 d_mm;
  bool along_surface;
  double into;    // greater than 0: d leads into the tetrahedron
  bool is_clear;  // rounding does not choose its sign

  // `tetrahedra`: the first is the flank.
  void Set(HapticCell& its_cell, const Carrier& carrier, std::uint8_t its_faces,
           std::uint32_t tetrahedra) {
    cell = &its_cell;
    triangle = &carrier;
    faces = its_faces;
    tetrahedron = std::countr_zero(tetrahedra);
  }

  void Pull(const Vec3& w_mm, double w2, Contact contact, CellCache& cache) noexcept {
    const TetrahedronGradients gradients = cache.Gradients(*cell, tetrahedron);
    const auto& vertices = cell->parts.complex.vertices[tetrahedron];
    const unsigned others = cell->parts.complex.vertex_mask[tetrahedron] & ~triangle->Mask();
    int n = 0;
    while (n < 3 && !(others >> vertices[n] & 1)) ++n;
    inward = &gradients.weight[n];
    fall = &gradients.fall;
    const double along = fall->normal.dot(w_mm);
    along_surface = Crosses(contact, along);
    d_mm = w_mm;
    if (along_surface) d_mm -= (along / fall->normal2) * fall->normal;
    into = inward->normal.dot(d_mm);
    is_clear = into * into > kClearOfTriangle2 * w2 * inward->normal2;
  }

  void Take(const Vec3& d, bool along, bool full, Candidate& best) const noexcept {
    best.kind = Candidate::Kind::kTetrahedron;
    best.cell = cell->cell;
    best.entry = cell;
    best.faces = faces;
    best.carrier = *triangle;
    best.tetrahedron = tetrahedron;
    best.d_mm = d;
    best.along_surface = along;
    best.full = full;
  }
};

// std::has_single_bit calls a function for each popcount.
bool IsSingle(unsigned bits) { return bits != 0 && (bits & (bits - 1)) == 0; }

// Sets the flanks of a triangle of `cell` in the order in which a search visits them. `mapped` is
// room for the triangle in another cell. Returns false if it is not between two tetrahedra.
bool FindFlanks(const HapticSurface& surface, const Place& place, HapticCell& cell,
                CellCache& cache, Carrier& mapped, std::array<Flank, 2>& flanks) noexcept {
  if (!cell.IsCrossed(surface)) return false;
  const std::uint32_t here = TetrahedraAt(cell.parts.complex, place.carrier);
  if (place.faces == 0) {
    const std::uint32_t second = here & (here - 1);
    if (!IsSingle(second)) return false;
    flanks[0].Set(cell, place.carrier, 0, here);
    flanks[1].Set(cell, place.carrier, 0, second);
    return true;
  }
  if (!IsSingle(place.faces) || !IsSingle(here)) return false;
  const int face = std::countr_zero<unsigned>(place.faces), side = face % 2;
  const Vec3i offset = (2 * side - 1) * Vec3i::Unit(face / 2);
  if (!surface.lattice.HasCell(place.cell + offset)) return false;
  HapticCell& other = cache.Densities(surface, place.cell + offset);
  if (!other.IsCrossed(surface)) return false;
  cache.Decompose(surface, other);
  mapped = CarrierInNeighbour(place.carrier, offset);
  const std::uint32_t there = TetrahedraAt(other.parts.complex, mapped);
  flanks[1 - side].Set(cell, place.carrier, place.faces, here);
  // The same face, from its other side.
  const auto faces = static_cast<std::uint8_t>(place.faces ^ 3u << (face & ~1));
  flanks[side].Set(other, mapped, faces, there);
  return IsSingle(there);
}

// Inside a triangle, most pulls lead into one of its tetrahedra and out of the other, as two signs
// tell. Then the longest projection is that of the first: the other's lies in the triangle, so it
// is in both cones, and shorter. Where rounding could choose, both are examined as in a search.
// (Where one gradient of the density is 10⁸ times the other, as in a plateau of ties, a search
// takes a direction for one of the other's, too, that is not: within 10⁻³ of its length. This does
// not.) Returns false if the triangle is not between two tetrahedra.
bool FindAtTriangle(const HapticSurface& surface, const Place& place, HapticCell& cell,
                    Contact contact, const Vec3& w_mm, CellCache& cache, int& tetrahedra,
                    Candidate& best) noexcept {
  std::array<Flank, 2> flanks;
  Carrier mapped;
  if (!FindFlanks(surface, place, cell, cache, mapped, flanks)) return false;
  const double w2 = w_mm.squaredNorm();
  for (Flank& flank : flanks) flank.Pull(w_mm, w2, contact, cache);
  const bool into_first = flanks[0].into > 0.0;
  if (flanks[0].is_clear && flanks[1].is_clear && into_first != (flanks[1].into > 0.0)) {
    const Flank& to = flanks[into_first ? 0 : 1];
    to.Take(to.d_mm, to.along_surface, !to.along_surface, best);
    // A search ends at the whole pull.
    tetrahedra += into_first && best.full ? 1 : 2;
    return true;
  }
  double best_2 = 0.0;
  for (const Flank& flank : flanks) {
    ++tetrahedra;
    Cone cone;
    cone.Add(*flank.inward);
    if (contact != Contact::kNone) cone.Add(FreeSideOf(*flank.fall, contact));
    const ConeProjection projection = ProjectOnCone(w_mm, cone, best_2);
    const double length2 = projection.d.squaredNorm();
    if (!(length2 > best_2)) continue;
    best_2 = length2;
    flank.Take(projection.d, projection.active >> 1 & 1, projection.active == 0, best);
    if (best.full) break;
  }
  return true;
}

}  // namespace

Candidate BestDirection(const HapticSurface& surface, const Place& place, HapticCell* held,
                        Contact contact, const Vec3& w_mm, CellCache& cache,
                        int& tetrahedra) noexcept {
  Candidate best;
  if (place.kind == Place::Kind::kSimplex && place.carrier.count >= 3) {
    HapticCell& cell = held ? *held : cache.Decomposed(surface, place.cell);
    if (place.tetrahedron >= 0) {
      ++tetrahedra;
      SetDirectionInside(cell, place, contact, w_mm, cache, best);
      return best;
    }
    if (place.carrier.count == 3 &&
        FindAtTriangle(surface, place, cell, contact, w_mm, cache, tetrahedra, best)) {
      return best;
    }
  }
  DirectionSearch search(surface, place, contact, w_mm, cache, tetrahedra, best);
  if (place.faces == 0) {
    search.Visit(Vec3i::Zero());
  } else {
    VisitNeighbours(place.faces, [&](const Vec3i& offset) { search.Visit(offset); });
  }
  return best;
}

Candidate SteepestWay(const HapticSurface& surface, const Place& place, Contact towards,
                      CellCache& cache) noexcept {
  Candidate best;
  double best_slope = 0.0;
  VisitNeighbours(place.faces, [&](const Vec3i& offset) {
    Candidate candidate;
    candidate.cell = place.cell + offset;
    if (!surface.lattice.HasCell(candidate.cell)) return;
    candidate.faces = FacesInNeighbour(place.faces, offset);
    HapticCell& cell = cache.Decomposed(surface, candidate.cell);
    candidate.kind = Candidate::Kind::kTetrahedron;
    candidate.entry = &cell;
    candidate.carrier = CarrierIn(cell, place, offset, candidate.faces);
    const std::uint16_t mask = candidate.carrier.Mask();
    for (std::uint32_t left = TetrahedraAt(cell.parts.complex, candidate.carrier); left;
         left &= left - 1) {
      const int t = std::countr_zero(left);
      const TetrahedronGradients gradients = cache.Gradients(cell, t);
      const TetrahedronCone tangent = MakeTetrahedronCone(cell, t, mask, gradients, Contact::kNone);
      const Vec3 steepest = FreeSideOf(gradients.fall, towards).normal;
      const Vec3 d = ProjectOnCone(steepest, tangent.cone).d;
      // d is orthogonal to the part that the cone cuts off, so the slope along d is |d|.
      const double slope = d.norm();
      if (!(slope > best_slope * kSteeper)) continue;
      if (!(slope > kNoSlope * std::sqrt(gradients.fall.normal2))) continue;
      best_slope = slope;
      best = candidate;
      best.tetrahedron = t;
      // Long enough for the density to change by its whole range.
      best.d_mm = d / (slope * slope);
    }
  });
  return best;
}

}  // namespace palpate
