// Projections on cones and the choice of a direction, bit by bit against plain searches: every face
// of every cone, in every tetrahedron and free cell at the place.

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "server/haptics/moves.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using testing::Gyroid;
using testing::MakeVolume;

struct Projection {
  Vec3 d = Vec3::Zero();
  unsigned active = 0;
};

Projection PlainProjection(const Vec3& w, const std::vector<Vec3>& normals) {
  Projection best;
  double best2 = 0.0;
  const auto consider = [&](const Vec3& d, unsigned active) {
    const double length2 = d.squaredNorm();
    for (std::size_t i = 0; i < normals.size(); ++i) {
      if (active >> i & 1) continue;
      const double inside = normals[i].dot(d);
      const double tolerance2 = 1e-12 * 1e-12 * length2 * normals[i].squaredNorm();
      if (inside < 0.0 && inside * inside > tolerance2) return;
    }
    if (length2 > best2) best = {d, active}, best2 = length2;
  };
  bool is_inside = true;
  for (const Vec3& normal : normals) is_inside = is_inside && normal.dot(w) >= 0.0;
  if (is_inside) return {w, 0};
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const double along = normals[i].dot(w);
    if (along < 0.0) consider(w - (along / normals[i].squaredNorm()) * normals[i], 1u << i);
  }
  for (std::size_t i = 0; i < normals.size(); ++i) {
    for (std::size_t j = i + 1; j < normals.size(); ++j) {
      const Vec3 edge = normals[i].cross(normals[j]);
      const double edge2 = edge.squaredNorm();
      if (edge2 > 0.0) consider(edge * (edge.dot(w) / edge2), 1u << i | 1u << j);
    }
  }
  return best;
}

class Dice {
 public:
  double Uniform(double low, double high) { return low + (high - low) * uniform_(bits_); }
  int Below(int count) { return static_cast<int>(bits_() % static_cast<unsigned>(count)); }
  Vec3 Direction() {
    Vec3 d;
    for (double& x : d) x = normal_(bits_);
    return d.normalized();
  }
  Vec3 AnyLength() { return std::pow(10.0, Uniform(-3.0, 1.0)) * Direction(); }
  // Zero, or a share of any size down to what rounding decides.
  double Share() {
    return Below(4) ? Uniform(-1.0, 1.0) * std::pow(10.0, Uniform(-17.0, -2.0)) : 0.0;
  }

 private:
  std::mt19937_64 bits_{3};
  std::uniform_real_distribution<double> uniform_;
  std::normal_distribution<double> normal_;
};

// With a few normals nearly parallel, and pulls nearly in a plane. Where two are closer than 1e-7,
// rounding chooses the edge between them.
TEST(ProjectOnCone, IsThatOfAPlainSearch) {
  Dice dice;
  int differ = 0, shorter = 0;
  for (int n = 0; n < 1'000'000; ++n) {
    std::vector<Vec3> normals;
    Cone cone;
    for (int count = 1 + dice.Below(4); count > 0; --count) {
      Vec3 normal = dice.AnyLength();
      if (!normals.empty() && dice.Below(4) == 0) {
        const double turn = std::pow(10.0, dice.Uniform(-7.0, 0.0));
        normal = (dice.Below(2) ? 1.0 : -1.0) * normals.back() +
                 turn * normals.back().norm() * dice.Direction();
      }
      normals.push_back(normal);
      cone.Add(HalfSpace(normal));
    }
    Vec3 w = dice.AnyLength();
    const Vec3& near = normals[static_cast<std::size_t>(dice.Below(cone.count))];
    if (dice.Below(2)) w -= (1.0 - dice.Share()) * (near.dot(w) / near.squaredNorm()) * near;
    const Projection plain = PlainProjection(w, normals);
    const ConeProjection found = ProjectOnCone(w, cone);
    differ += found.d != plain.d || found.active != plain.active;
    const double longer_than2 = plain.d.squaredNorm() * (1.0 + dice.Share());
    const bool is_longer = plain.d.squaredNorm() > longer_than2;
    shorter += !is_longer;
    const ConeProjection longer = ProjectOnCone(w, cone, longer_than2);
    differ += longer.d != (is_longer ? plain.d : Vec3::Zero());
  }
  EXPECT_EQ(differ, 0);
  EXPECT_GT(shorter, 100'000);
}

// A cell as the volume has it, without a cache.
struct PlainCell {
  PlainCell(const HapticSurface& surface, const Vec3i& index)
      : parts(Decompose(surface.volume->ResolvedCell(index), surface.method)) {
    for (int v = 0; v < kMaxVertices; ++v) {
      parts.density[v] *= surface.sign();
      vertex_mm[v] = surface.X_DI.linear * parts.position[v];
    }
  }

  std::array<Vec3, 4> GradientsOfWeights(int tetrahedron) const {
    const auto& v = parts.complex.vertices[tetrahedron];
    const auto at = [&](int n) { return Vec3(vertex_mm[v[n]] - vertex_mm[v[0]]); };
    const Vec3 a = at(1), b = at(2), c = at(3), bc = b.cross(c);
    const double inverse_det = 1.0 / a.dot(bc);
    const Vec3 g1 = bc * inverse_det, g2 = c.cross(a) * inverse_det, g3 = a.cross(b) * inverse_det;
    return {-(g1 + g2 + g3), g1, g2, g3};
  }
  Vec3 Gradient(int tetrahedron) const {
    const auto& v = parts.complex.vertices[tetrahedron];
    const auto& d = parts.density;
    const std::array<Vec3, 4> w = GradientsOfWeights(tetrahedron);
    return (d[v[1]] - d[v[0]]) * w[1] + (d[v[2]] - d[v[0]]) * w[2] + (d[v[3]] - d[v[0]]) * w[3];
  }

  Decomposition parts;
  std::array<Vec3, kMaxVertices> vertex_mm;
};

class PlainSearch {
 public:
  PlainSearch(const HapticSurface& surface, const Place& place, Contact contact, const Vec3& w_mm)
      : surface_(surface), place_(place), contact_(contact), w_mm_(w_mm) {}

  Candidate Run(CellCache& cache, int& tetrahedra) {
    VisitNeighbours(place_.faces, [&](const Vec3i& offset) {
      const Vec3i index = place_.cell + offset;
      if (best_.full || !surface_.volume->HasCell(index)) return;
      HapticCell& cell = cache.Decomposed(surface_, index);
      const std::uint8_t faces = FacesInNeighbour(place_.faces, offset);
      if (cell.IsFree(surface_)) return VisitBox(index, faces);
      if (cell.IsCrossed(surface_)) VisitTetrahedra(cell, offset, faces, tetrahedra);
    });
    return best_;
  }

 private:
  void VisitBox(const Vec3i& index, std::uint8_t faces) {
    std::vector<Vec3> normals;
    for (int side = 0; side < 6; ++side) {
      const Vec3 normal = surface_.X_ID.linear.row(side / 2);
      if (faces >> side & 1) normals.push_back(side % 2 ? Vec3(-normal) : normal);
    }
    const Projection projection = PlainProjection(w_mm_, normals);
    if (!(projection.d.squaredNorm() > best_.d_mm.squaredNorm())) return;
    best_ = {.kind = Candidate::Kind::kBox,
             .cell = index,
             .faces = faces,
             .carrier = best_.carrier,
             .tetrahedron = best_.tetrahedron,
             .d_mm = projection.d,
             .full = projection.active == 0};
  }

  void VisitTetrahedra(HapticCell& cell, const Vec3i& offset, std::uint8_t faces, int& tetrahedra) {
    const Carrier carrier = place_.kind == Place::Kind::kSimplex
                                ? CarrierInNeighbour(place_.carrier, offset)
                                : Locate(cell, place_.p_L - cell.cell.cast<double>(), faces);
    const PlainCell plain(surface_, cell.cell);
    for (int t = 0; t < plain.parts.complex.tetrahedron_count && !best_.full; ++t) {
      if (!(TetrahedraAt(plain.parts.complex, carrier) >> t & 1)) continue;
      ++tetrahedra;
      const std::array<Vec3, 4> weights = plain.GradientsOfWeights(t);
      const auto& v = plain.parts.complex.vertices[t];
      std::vector<Vec3> normals;
      for (int n = 0; n < 4; ++n) {
        if (!(carrier.Mask() >> v[n] & 1)) normals.push_back(weights[static_cast<std::size_t>(n)]);
      }
      const Vec3 gradient = plain.Gradient(t);
      const std::size_t under_surface = normals.size();
      if (contact_ != Contact::kNone && !gradient.isZero(0.0)) {
        normals.push_back(contact_ == Contact::kUpper ? Vec3(-gradient) : gradient);
      }
      const Projection projection = PlainProjection(w_mm_, normals);
      if (!(projection.d.squaredNorm() > best_.d_mm.squaredNorm())) continue;
      best_ = {.kind = Candidate::Kind::kTetrahedron,
               .cell = cell.cell,
               .faces = faces,
               .carrier = carrier,
               .tetrahedron = t,
               .d_mm = projection.d,
               .along_surface = (projection.active >> under_surface & 1) != 0,
               .full = projection.active == 0};
    }
  }

  const HapticSurface& surface_;
  const Place& place_;
  const Contact contact_;
  const Vec3 w_mm_;
  Candidate best_;
};

bool AreSame(const Candidate& a, const Candidate& b) {
  const bool is_in_tetrahedron = a.kind == Candidate::Kind::kTetrahedron;
  return a.kind == b.kind && a.d_mm == b.d_mm && a.full == b.full &&
         (a.kind == Candidate::Kind::kNone ||
          (a.cell == b.cell && a.faces == b.faces && a.along_surface == b.along_surface)) &&
         (!is_in_tetrahedron ||
          (a.tetrahedron == b.tetrahedron && a.carrier.count == b.carrier.count &&
           a.carrier.Mask() == b.carrier.Mask() && a.carrier.weight == b.carrier.weight));
}

// A pull of any direction and length, or one nearly in the plane of a face or of H.
Vec3 AnyPull(const HapticSurface& surface, const Place& place, Dice& dice) {
  const Vec3 w = dice.AnyLength();
  if (place.kind != Place::Kind::kSimplex || dice.Below(2)) return w;
  const PlainCell cell(surface, place.cell);
  std::vector<Vec3> normals;
  for (int t = 0; t < cell.parts.complex.tetrahedron_count; ++t) {
    if (!(TetrahedraAt(cell.parts.complex, place.carrier) >> t & 1)) continue;
    for (const Vec3& weight : cell.GradientsOfWeights(t)) normals.push_back(weight);
    if (const Vec3 gradient = cell.Gradient(t); !gradient.isZero(0.0)) normals.push_back(gradient);
  }
  if (normals.empty()) return w;
  const Vec3& near =
      normals[static_cast<std::size_t>(dice.Below(static_cast<int>(normals.size())))];
  return w - (1.0 - dice.Share()) * (near.dot(w) / near.squaredNorm()) * near;
}

// Walks where the pulls lead, and begins anew now and then.
void Compare(const HapticSurface& surface, Dice& dice) {
  CellCache cache, plain_cache;
  Place place;
  Contact contact = Contact::kNone;
  int differ = 0, compared = 0, in_triangles = 0;
  while (compared < 40'000) {
    if (place.kind == Place::Kind::kOutside || compared % 50 == 0) {
      double density = 0.0;
      const Vec3 size = surface.volume->size().cast<double>();
      const Vec3 p_I = 0.5 * (size + size.cwiseProduct(dice.Uniform(0.0, 0.9) * dice.Direction()));
      place = PlaceAt(surface, p_I, cache, density);
      contact = Contact::kNone;
      if (!surface.Holds(density)) continue;
    }
    const Vec3 w_mm = AnyPull(surface, place, dice);
    int tetrahedra = 0, plain_tetrahedra = 0;
    const bool holds = place.kind == Place::Kind::kSimplex && compared % 2 == 0;
    HapticCell* const held = holds ? &cache.Decomposed(surface, place.cell) : nullptr;
    const Candidate best = BestDirection(surface, place, held, contact, w_mm, cache, tetrahedra);
    const Candidate plain =
        PlainSearch(surface, place, contact, w_mm).Run(plain_cache, plain_tetrahedra);
    ++compared;
    in_triangles += place.kind == Place::Kind::kSimplex && place.carrier.count == 3;
    // A search beyond the lattice is not compared.
    if (best.kind == Candidate::Kind::kOutside) {
      place = Place();
      continue;
    }
    differ += !AreSame(best, plain) || tetrahedra != plain_tetrahedra;
    if (best.kind == Candidate::Kind::kTetrahedron) {
      MoveInTetrahedron(surface, best, Contact::kNone, place, contact, cache);
    } else if (best.kind == Candidate::Kind::kBox) {
      MoveInBox(surface, best, place, cache);
      contact = Contact::kNone;
    }
  }
  EXPECT_EQ(differ, 0);
  EXPECT_GT(in_triangles, 5'000);
}

TEST(BestDirection, IsThatOfAPlainSearch) {
  Dice dice;
  AffineMap skewed;
  skewed.linear << 0.4, 0.1, 0.0, -0.2, 0.5, 0.1, 0.0, 0.2, -0.9;
  std::mt19937_64 random(5);
  // Six saddles in most cells; then ties in most cells.
  const auto board = MakeVolume(Vec3i::Constant(24), [&](int i, int j, int k) {
    return 0.5 * ((i + j + k) % 2) + static_cast<double>(random() % 1000) / 2000.0;
  });
  const auto ties = MakeVolume(Vec3i::Constant(24),
                               [&](int, int, int) { return static_cast<double>(random() % 4); });
  for (const auto& volume : {Gyroid(24), board, ties}) {
    for (const FreeSide side : {FreeSide::kBelow, FreeSide::kAbove}) {
      for (const auto method : {DecompositionMethod::kTpbcc, DecompositionMethod::kBcc}) {
        SCOPED_TRACE(static_cast<int>(side));
        Compare(MakeHapticSurface(*volume, AffineMap(), 0.5, method, 1, side), dice);
        Compare(MakeHapticSurface(*volume, skewed, 0.4, method, 2, side), dice);
        // The value of many voxels of the last volume.
        HapticSurface band = MakeHapticSurface(*volume, skewed, 1.0 / 3.0, method, 2, side);
        Compare(band, dice);
        band.lower = band.isovalue - 0.1;
        Compare(band, dice);
      }
    }
  }
}

}  // namespace
}  // namespace palpate
