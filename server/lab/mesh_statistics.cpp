#include "server/lab/mesh_statistics.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace palpate::lab {
namespace {

using Edge = std::pair<std::uint32_t, std::uint32_t>;

// The numbers of the triangles at each vertex.
struct VertexTriangles {
  std::vector<std::uint32_t> first;  // triangles of vertex v: first[v] .. first[v + 1]
  std::vector<std::uint32_t> triangle;

  explicit VertexTriangles(const SurfaceMesh& mesh)
      : first(mesh.vertices.size() + 1), triangle(3 * mesh.triangles.size()) {
    for (const auto& corners : mesh.triangles) {
      for (std::uint32_t v : corners) ++first[v];
    }
    std::uint32_t sum = 0;
    for (std::uint32_t& n : first) sum += std::exchange(n, sum);
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      for (std::uint32_t v : mesh.triangles[t]) {
        triangle[first[v]++] = static_cast<std::uint32_t>(t);
      }
    }
    // Each entry has moved to the start of the next vertex.
    std::rotate(first.begin(), first.end() - 1, first.end());
    first[0] = 0;
  }
};

// A forest over vertex numbers: each tree is one component.
class MeshComponents {
 public:
  explicit MeshComponents(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0u);
  }

  std::uint32_t Find(std::uint32_t x) {
    while (parent_[x] != x) x = parent_[x] = parent_[parent_[x]];
    return x;
  }

  // False if both were already in the same component.
  bool Join(std::uint32_t a, std::uint32_t b) {
    a = Find(a);
    b = Find(b);
    if (a == b) return false;
    parent_[std::max(a, b)] = std::min(a, b);
    return true;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

// The summed results of the triangles around single vertices.
struct LinkSums {
  MeshStatistics counts;
  std::vector<Edge> boundary;

  void Add(const LinkSums& other) {
    counts.edges += other.counts.edges;
    counts.boundary_edges += other.counts.boundary_edges;
    counts.non_manifold_edges += other.counts.non_manifold_edges;
    counts.misoriented_edges += other.counts.misoriented_edges;
    counts.non_manifold_vertices += other.counts.non_manifold_vertices;
    boundary.insert(boundary.end(), other.boundary.begin(), other.boundary.end());
  }
};

// Reads the link of a vertex: each triangle at the vertex gives one edge from a neighbour to the
// next.
class LinkReader {
 public:
  LinkReader(const SurfaceMesh& mesh, const VertexTriangles& at) : mesh_(mesh), at_(at) {}

  void Read(std::uint32_t v, LinkSums& part) {
    const std::span<const std::uint32_t> triangles(at_.triangle.data() + at_.first[v],
                                                   at_.triangle.data() + at_.first[v + 1]);
    link_.clear();
    neighbours_.clear();
    for (std::uint32_t t : triangles) {
      const auto& c = mesh_.triangles[t];
      const int n = c[0] == v ? 0 : c[1] == v ? 1 : 2;
      const Edge edge(c[(n + 1) % 3], c[(n + 2) % 3]);
      link_.push_back(edge);
      neighbours_.push_back({edge.first, true});
      neighbours_.push_back({edge.second, false});
    }
    std::sort(neighbours_.begin(), neighbours_.end());
    CountEdges(v, part);
    part.counts.non_manifold_vertices += CountFans() > 1;
  }

 private:
  void CountEdges(std::uint32_t v, LinkSums& part) const {
    for (std::size_t begin = 0, end; begin < neighbours_.size(); begin = end) {
      const std::uint32_t w = neighbours_[begin].first;
      int leaving = 0;
      for (end = begin; end < neighbours_.size() && neighbours_[end].first == w; ++end) {
        leaving += neighbours_[end].second;
      }
      if (w < v) continue;  // counted at w
      const std::size_t count = end - begin;
      ++part.counts.edges;
      part.counts.non_manifold_edges += count > 2;
      part.counts.misoriented_edges += count == 2 && leaving != 1;
      if (count == 1) {
        ++part.counts.boundary_edges;
        part.boundary.push_back({v, w});
      }
    }
  }

  // Counts the pieces of the link by flooding. Links are small, so a simple flood is fast
  // enough.
  int CountFans() {
    int fans = 0;
    while (!link_.empty()) {
      ++fans;
      reached_ = {link_.back().first, link_.back().second};
      link_.pop_back();
      for (std::size_t n = 0; n < reached_.size(); ++n) {
        const std::uint32_t w = reached_[n];
        std::erase_if(link_, [&](const Edge& edge) {
          if (edge.first != w && edge.second != w) return false;
          reached_.push_back(edge.first == w ? edge.second : edge.first);
          return true;
        });
      }
    }
    return fans;
  }

  const SurfaceMesh& mesh_;
  const VertexTriangles& at_;
  std::vector<Edge> link_;
  // true: the triangle runs to the neighbour
  std::vector<std::pair<std::uint32_t, bool>> neighbours_;
  std::vector<std::uint32_t> reached_;
};

LinkSums ReadLinks(const SurfaceMesh& mesh) {
  const VertexTriangles at(mesh);
  const auto count = static_cast<std::uint32_t>(mesh.vertices.size());
  return tbb::parallel_reduce(
      tbb::blocked_range<std::uint32_t>(0, count, 10'000), LinkSums{},
      [&](const tbb::blocked_range<std::uint32_t>& range, LinkSums part) {
        LinkReader reader(mesh, at);
        for (std::uint32_t v = range.begin(); v < range.end(); ++v) reader.Read(v, part);
        return part;
      },
      [](LinkSums l, const LinkSums& r) {
        l.Add(r);
        return l;
      });
}

// True if both ends lie in one face of the range. The comparison is exact: vertices in the face are
// interpolated between equal coordinates.
bool LiesInBorder(const SurfaceMesh& mesh, const Edge& edge) {
  for (int axis = 0; axis < 3; ++axis) {
    const double a = mesh.vertices[edge.first][axis], b = mesh.vertices[edge.second][axis];
    if (a == b && (a == mesh.range.first[axis] || a == mesh.range.end[axis])) return true;
  }
  return false;
}

}  // namespace

MeshStatistics MeasureMesh(const SurfaceMesh& mesh) {
  const LinkSums part = ReadLinks(mesh);
  MeshStatistics s = part.counts;
  s.vertices = static_cast<std::int64_t>(mesh.vertices.size());
  s.triangles = static_cast<std::int64_t>(mesh.triangles.size());
  s.euler = s.vertices - s.edges + s.triangles;

  s.components = s.vertices;
  MeshComponents pieces(mesh.vertices.size());
  for (const auto& t : mesh.triangles)
    s.components -= pieces.Join(t[0], t[1]) + pieces.Join(t[0], t[2]);

  // In a manifold, every boundary vertex has two boundary edges. So an edge that joins two vertices
  // of the same component closes a loop.
  if (!part.boundary.empty()) {
    MeshComponents loops(mesh.vertices.size());
    for (const Edge& edge : part.boundary) {
      s.boundary_loops += !loops.Join(edge.first, edge.second);
      s.boundary_edges_off_border += !LiesInBorder(mesh, edge);
    }
  }
  return s;
}

}  // namespace palpate::lab
