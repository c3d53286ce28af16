// Topology of the piecewise-linear level set of one decomposed cell.
#pragma once

#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "common/isosurface/decomposition.h"

namespace palpate::testing {

class DisjointSets {
 public:
  explicit DisjointSets(int n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0); }
  int Find(int x) { return parent_[x] == x ? x : parent_[x] = Find(parent_[x]); }
  void Join(int a, int b) { parent_[Find(a)] = Find(b); }

 private:
  std::vector<int> parent_;
};

struct CellTopology {
  int above = 0;    // components of {density > τ}
  int below = 0;    // components of {density < τ}
  int surface = 0;  // components of H
  int euler = 0;    // Euler characteristic of H

  bool operator==(const CellTopology&) const = default;
};

inline CellTopology TopologyOf(const Decomposition& cell, double isovalue) {
  const TetrahedralComplex& complex = cell.complex;
  DisjointSets vertices(kMaxVertices), edges(kMaxVertices * kMaxVertices);
  std::set<int> crossed_edges;
  std::set<std::array<int, 3>> crossed_triangles;
  int polygons = 0;
  const auto above = [&](int v) { return cell.density[v] > isovalue; };
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    const auto& v = complex.vertices[t];
    int first_edge = -1;
    for (int i = 0; i < 4; ++i) {
      for (int j = i + 1; j < 4; ++j) {
        const int lo = std::min(v[i], v[j]), hi = std::max(v[i], v[j]);
        if (above(lo) == above(hi)) {
          vertices.Join(lo, hi);
          continue;
        }
        const int edge = lo * kMaxVertices + hi;
        crossed_edges.insert(edge);
        if (first_edge < 0) first_edge = edge;
        edges.Join(first_edge, edge);
      }
      std::array<int, 3> triangle;
      for (int j = 0, n = 0; j < 4; ++j) {
        if (j != i) triangle[n++] = v[j];
      }
      std::sort(triangle.begin(), triangle.end());
      if (above(triangle[0]) != above(triangle[1]) || above(triangle[1]) != above(triangle[2])) {
        crossed_triangles.insert(triangle);
      }
    }
    polygons += first_edge >= 0;
  }
  CellTopology topology;
  std::set<int> roots_above, roots_below, roots_surface;
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(complex.used_vertices >> v & 1)) continue;
    (above(v) ? roots_above : roots_below).insert(vertices.Find(v));
  }
  for (int edge : crossed_edges) roots_surface.insert(edges.Find(edge));
  topology.above = static_cast<int>(roots_above.size());
  topology.below = static_cast<int>(roots_below.size());
  topology.surface = static_cast<int>(roots_surface.size());
  topology.euler = static_cast<int>(crossed_edges.size()) -
                   static_cast<int>(crossed_triangles.size()) + polygons;
  return topology;
}

}  // namespace palpate::testing
