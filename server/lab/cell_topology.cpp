#include "server/lab/cell_topology.h"

#include <algorithm>
#include <bit>
#include <bitset>

namespace palpate::lab {
namespace {

// Each crossed edge has one vertex of H, with the number 16 low + high.
constexpr int kEdges = kMaxVertices * kMaxVertices;

template <int N>
class Components {
 public:
  void Add(int x) {
    if (parent_[x] < 0) parent_[x] = x, ++count_;
  }
  void Join(int a, int b) {
    Add(a);
    Add(b);
    a = Find(a);
    b = Find(b);
    if (a == b) return;
    parent_[a] = b;
    --count_;
  }
  int count() const { return count_; }

 private:
  int Find(int x) {
    while (parent_[x] != x) x = parent_[x];
    return x;
  }

  std::array<int, N> parent_ = [] {
    std::array<int, N> none;
    none.fill(-1);
    return none;
  }();
  int count_ = 0;
};

}  // namespace

CellTopology CountCellTopology(const Decomposition& cell, double isovalue) {
  const TetrahedralComplex& complex = cell.complex;
  unsigned above = 0;
  for (int v = 0; v < kMaxVertices; ++v) {
    if ((complex.used_vertices >> v & 1) && cell.density[v] > isovalue) above |= 1u << v;
  }
  Components<kMaxVertices> solid, free;
  Components<kEdges> surface;
  std::bitset<kEdges> edges;
  std::array<unsigned, 4 * kMaxTetrahedra> triangles;
  int triangle_count = 0, polygons = 0;
  for (int v = 0; v < kMaxVertices; ++v) {
    if (complex.used_vertices >> v & 1) (above >> v & 1 ? solid : free).Add(v);
  }
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    const auto& v = complex.vertices[t];
    int first = -1;
    for (int i = 0; i < 4; ++i) {
      for (int j = i + 1; j < 4; ++j) {
        const bool is_above = above >> v[i] & 1;
        if (is_above == (above >> v[j] & 1)) {
          (is_above ? solid : free).Join(v[i], v[j]);
          continue;
        }
        const int edge = kMaxVertices * std::min(v[i], v[j]) + std::max(v[i], v[j]);
        edges.set(edge);
        if (first < 0) first = edge;
        surface.Join(first, edge);
      }
      const unsigned triangle = complex.vertex_mask[t] & ~(1u << v[i]);
      if ((triangle & above) != 0 && (triangle & ~above) != 0) {
        triangles[triangle_count++] = triangle;
      }
    }
    polygons += first >= 0;
  }
  std::sort(triangles.begin(), triangles.begin() + triangle_count);
  const auto unique = std::unique(triangles.begin(), triangles.begin() + triangle_count);
  CellTopology topology;
  topology.above = solid.count();
  topology.below = free.count();
  topology.surface = surface.count();
  topology.euler =
      static_cast<int>(edges.count()) - static_cast<int>(unique - triangles.begin()) + polygons;
  return topology;
}

}  // namespace palpate::lab
