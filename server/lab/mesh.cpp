#include "server/lab/mesh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"

namespace palpate::lab {
namespace {

// +1 or -1 for each tetrahedron: the sign of det(b - a, c - a, d - a) for its
// vertices a, b, c, d.
using TetrahedronSigns = std::array<int, kMaxTetrahedra>;

// The sign of the permutation that sorts the values. The values are distinct.
constexpr int PermutationSign(const std::array<int, 4>& values) {
  int sign = 1;
  for (int i = 0; i < 4; ++i) {
    for (int j = i + 1; j < 4; ++j) {
      if (values[i] > values[j]) sign = -sign;
    }
  }
  return sign;
}

// Corners and face vertices get their own positions, all other vertices the cell's centre.
Vec3 ReferencePosition(int v) {
  Vec3 p = Vec3::Constant(0.5);
  for (int axis = 0; axis < 3; ++axis) {
    const int sides = kVertexFaces[v] >> (2 * axis) & 3;
    if (sides != 0) p[axis] = sides == 2 ? 1.0 : 0.0;
  }
  return p;
}

// If three vertices lie in one face of the cell, the tetrahedron lies on the inner side of this
// face, wherever its fourth vertex is. Returns 0 if there is no such face.
int SignAtBorder(const std::array<std::uint8_t, 4>& vertices) {
  for (int apex = 0; apex < 4; ++apex) {
    unsigned faces = 0x3F;
    for (int n = 0; n < 4; ++n) {
      if (n != apex) faces &= kVertexFaces[vertices[n]];
    }
    if (faces == 0) continue;
    Vec3 p[4];
    for (int n = 0; n < 4; ++n) {
      p[n] = n == apex ? Vec3(Vec3::Constant(0.5)) : ReferencePosition(vertices[n]);
    }
    Mat3 m;
    for (int n = 0; n < 3; ++n) m.col(n) = p[n + 1] - p[0];
    return m.determinant() > 0.0 ? 1 : -1;
  }
  return 0;
}

// Derives the sign of tetrahedron `t` from the sign of `known`. The two share a triangle and lie on
// opposite sides of it.
int SignAcross(const TetrahedralComplex& complex, int t, int known, int known_sign) {
  const auto& from = complex.vertices[known];
  std::array<int, 4> place;  // places in `known` of t's vertices
  for (int n = 0; n < 4; ++n) {
    const int v = complex.vertices[t][n];
    const bool is_shared = complex.vertex_mask[known] >> v & 1;
    for (int m = 0; m < 4; ++m) {
      // t's own vertex takes the place of known's own vertex.
      if (is_shared ? from[m] == v : !(complex.vertex_mask[t] >> from[m] & 1)) place[n] = m;
    }
  }
  return -known_sign * PermutationSign(place);
}

// Finds the tetrahedra of a complex that are listed in positive order. Uses only the connections
// between tetrahedra. Positions cannot tell: around saddles near the border of a cell, tetrahedra
// may be flat, and in kTpbccPublished inverted.
TetrahedronSigns SignsOf(const TetrahedralComplex& complex) {
  TetrahedronSigns signs{};
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    signs[t] = SignAtBorder(complex.vertices[t]);
  }
  for (bool found = true; found;) {
    found = false;
    for (int t = 0; t < complex.tetrahedron_count; ++t) {
      for (int known = 0; known < complex.tetrahedron_count && signs[t] == 0; ++known) {
        const unsigned shared = complex.vertex_mask[t] & complex.vertex_mask[known];
        if (signs[known] == 0 || std::popcount(shared) != 3) continue;
        signs[t] = SignAcross(complex, t, known, signs[known]);
        found = true;
      }
    }
  }
  return signs;
}

// Marks a triangle's vertex as an entry of `upper` instead of `vertices`.
constexpr std::uint32_t kInUpperPlane = 1u << 31;

struct PlaneVertex {
  std::uint64_t key;    // identifies the edge within the plane
  std::uint32_t index;  // index of the vertex in the slab that owns it
};

// One slab of a mesh: the triangles of a few layers of cells along x.
//
// The plane between two slabs is the lower plane of the upper slab. Edges of the complex in this
// plane belong to the upper slab; the lower slab refers to them by key.
//
// Frame: L, index of the lattice. Threads: pure; slabs are made in parallel.
struct MeshSlab {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<PlaneVertex> lower;    // in the plane shared with the slab below, sorted by key
  std::vector<std::uint64_t> upper;  // keys in the plane shared with the slab above
};

struct SlabRequest {
  const Lattice& lattice;
  double isovalue;
  ComparedMethod method;
  CellRange range;      // the cells of the slab
  bool has_slab_above;  // false: this slab owns the vertices in its upper plane
};

constexpr std::uint32_t kNone = ~0u;

// Edges shared by several cells lie on a cube edge or in a face. Each belongs to the lattice vertex
// at the low corner of this cube edge or face:
//   0-2    cube edge along an axis
//   3-14   from corner n of the face across an axis to the face's vertex
//   15-17  diagonal of a face (kTptd)
constexpr int kSlots = 18;

struct EdgeSlot {
  std::int8_t slot = -1;  // negative: no other cell shares the edge
  std::array<std::int8_t, 3> offset{};
  bool across_x = false;  // the edge lies in a plane of constant x
};

using EdgeSlotTable = std::array<std::array<EdgeSlot, kMaxVertices>, kMaxVertices>;

constexpr EdgeSlotTable MakeEdgeSlots() {
  EdgeSlotTable table{};
  // gcc 12 ignores the default of -1 in nested arrays
  for (auto& row : table) row.fill(EdgeSlot{});
  const auto set = [&](int u, int v, const EdgeSlot& slot) { table[u][v] = table[v][u] = slot; };
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    const auto& corners = kFaceCorners[face];
    EdgeSlot entry;
    entry.offset[axis] = static_cast<std::int8_t>(face % 2);
    entry.across_x = axis == 0;
    for (int n = 0; n < 4; ++n) {
      entry.slot = static_cast<std::int8_t>(3 + 4 * axis + n);
      set(kFirstFaceVertex + face, corners[n], entry);
    }
    entry.slot = static_cast<std::int8_t>(15 + axis);
    set(corners[0], corners[2], entry);
  }
  for (const auto& [u, v, f, g] : kCubeEdges) {  // u is the low end
    EdgeSlot entry;
    for (int axis = 0; axis < 3; ++axis) {
      entry.offset[axis] = static_cast<std::int8_t>(kCornerOffset[u][axis]);
      if (kCornerOffset[u][axis] == kCornerOffset[v][axis]) continue;
      entry.slot = static_cast<std::int8_t>(axis);
      entry.across_x = axis != 0;
    }
    set(u, v, entry);
  }
  return table;
}
constexpr EdgeSlotTable kEdgeSlots = MakeEdgeSlots();

class SlabBuilder {
 public:
  explicit SlabBuilder(const SlabRequest& request)
      : request_(request),
        first_(request.range.first),
        end_(request.range.end),
        vertices_y_(end_.y() - first_.y() + 1),
        vertices_z_(end_.z() - first_.z() + 1) {
    for (auto& plane : above_) plane.resize(static_cast<std::size_t>(vertices_y_) * vertices_z_);
    for (auto& slots : slots_) slots.assign(above_[0].size() * kSlots, kNone);
  }

  MeshSlab Build() {
    FillAbove(first_.x(), above_[0]);
    for (int i = first_.x(); i < end_.x(); ++i) {
      FillAbove(i + 1, above_[1]);
      for (int j = first_.y(); j < end_.y(); ++j) {
        for (int k = first_.z(); k < end_.z(); ++k) {
          if (IsCellCrossed(j, k)) AddCell(Vec3i(i, j, k));
        }
      }
      std::swap(above_[0], above_[1]);
      std::swap(slots_[0], slots_[1]);
      std::fill(slots_[1].begin(), slots_[1].end(), kNone);
    }
    std::sort(slab_.lower.begin(), slab_.lower.end(),
              [](const PlaneVertex& l, const PlaneVertex& r) { return l.key < r.key; });
    return std::move(slab_);
  }

 private:
  std::size_t PlaneIndex(int j, int k) const {
    return static_cast<std::size_t>(j - first_.y()) * vertices_z_ + (k - first_.z());
  }

  void FillAbove(int i, std::vector<std::uint8_t>& plane) const {
    const int edge = request_.lattice.refinement();
    const Vec3i sub = request_.lattice.PartOf(Vec3i(i, first_.y(), first_.z())).sub;
    for (int j = first_.y() - sub.y(); j <= end_.y(); j += edge) {
      for (int k = first_.z() - sub.z(); k <= end_.z(); k += edge) {
        if (edge > 1) {
          FillAboveInCell(Vec3i(i, j, k), plane);
        } else {
          plane[PlaneIndex(j, k)] =
              request_.lattice.volume().ResolvedVertex(Vec3i(i, j, k)) > request_.isovalue;
        }
      }
    }
  }

  // Reads a cell of the voxels once for all vertices of the plane in it. `low`: the first of them.
  void FillAboveInCell(const Vec3i& low, std::vector<std::uint8_t>& plane) const {
    const int edge = request_.lattice.refinement();
    const auto [voxel_cell, sub] = request_.lattice.PartOf(low);
    const CellDensities d = request_.lattice.volume().ResolvedCell(voxel_cell);
    const bool is_crossed = IsCrossed(d, request_.isovalue);
    for (int y = 0; y < edge; ++y) {
      for (int z = 0; z < edge; ++z) {
        const int j = low.y() + y, k = low.z() + z;
        if (j < first_.y() || j > end_.y() || k < first_.z() || k > end_.z()) continue;
        const double density = is_crossed ? SubCell(d, Vec3i(sub.x(), y, z), edge)[0] : d[0];
        plane[PlaneIndex(j, k)] = density > request_.isovalue;
      }
    }
  }

  // Reads each lattice vertex's flag, computed once instead of once per cell.
  bool IsCellCrossed(int j, int k) const {
    const std::size_t n = PlaneIndex(j, k), m = n + vertices_z_;
    const auto& [l, u] = above_;
    const int count = l[n] + l[n + 1] + l[m] + l[m + 1] + u[n] + u[n + 1] + u[m] + u[m + 1];
    return count != 0 && count != 8;
  }

  void AddCell(const Vec3i& cell) {
    cell_ = cell;
    decomposition_ = Decompose(request_.lattice.ResolvedCell(cell), request_.method);
    const TetrahedralComplex& complex = decomposition_.complex;
    const auto [known, is_new] = signs_.try_emplace(complex.vertices);
    if (is_new) known->second = SignsOf(complex);
    const TetrahedronSigns& signs = known->second;
    local_.fill(kNone);
    unsigned above = 0;
    for (int v = 0; v < kMaxVertices; ++v) {
      if (!(complex.used_vertices >> v & 1)) continue;
      above |= static_cast<unsigned>(decomposition_.density[v] > request_.isovalue) << v;
    }
    for (int t = 0; t < complex.tetrahedron_count; ++t) {
      const unsigned inside = above & complex.vertex_mask[t];
      if (inside == 0 || inside == complex.vertex_mask[t]) continue;
      AddTetrahedron(complex.vertices[t], signs[t], above);
    }
  }

  void AddTetrahedron(const std::array<std::uint8_t, 4>& vertices, int sign, unsigned above) {
    std::array<int, 4> place{};  // the vertices inside, then the vertices outside
    int inside = 0, outside = 4;
    for (int n = 0; n < 4; ++n) (above >> vertices[n] & 1 ? place[inside++] : place[--outside]) = n;
    const bool lone_outside = inside == 3;
    if (lone_outside) std::reverse(place.begin(), place.end());
    const bool outwards = (sign * PermutationSign(place) > 0) != lone_outside;
    std::array<int, 4> v;
    for (int n = 0; n < 4; ++n) v[n] = vertices[place[n]];
    if (inside != 2) {
      const std::uint32_t p = Vertex(v[0], v[1]), q = Vertex(v[0], v[2]), r = Vertex(v[0], v[3]);
      AddTriangle(p, q, r, outwards);
      return;
    }
    const std::uint32_t p = Vertex(v[0], v[2]), q = Vertex(v[0], v[3]);
    const std::uint32_t r = Vertex(v[1], v[3]), s = Vertex(v[1], v[2]);
    AddTriangle(p, q, r, outwards);
    AddTriangle(p, r, s, outwards);
  }

  void AddTriangle(std::uint32_t p, std::uint32_t q, std::uint32_t r, bool outwards) {
    if (!outwards) std::swap(q, r);
    slab_.triangles.push_back({p, q, r});
  }

  // Returns the mesh's vertex on the edge between two vertices of the current complex.
  std::uint32_t Vertex(int u, int v) {
    std::uint32_t& local = local_[u < v ? u * kMaxVertices + v : v * kMaxVertices + u];
    if (local != kNone) return local;
    const EdgeSlot& entry = kEdgeSlots[u][v];
    if (entry.slot < 0) return local = NewVertex(u, v);
    const std::uint64_t key =
        PlaneIndex(cell_.y() + entry.offset[1], cell_.z() + entry.offset[2]) * kSlots +
        static_cast<std::uint64_t>(entry.slot);
    std::uint32_t& shared = slots_[entry.offset[0]][key];
    if (shared == kNone) shared = NewSharedVertex(u, v, entry, key);
    return local = shared;
  }

  std::uint32_t NewSharedVertex(int u, int v, const EdgeSlot& entry, std::uint64_t key) {
    const int x = cell_.x() + entry.offset[0];
    if (request_.has_slab_above && x == end_.x()) {
      slab_.upper.push_back(key);
      return static_cast<std::uint32_t>(slab_.upper.size() - 1) | kInUpperPlane;
    }
    const std::uint32_t index = NewVertex(u, v);
    if (entry.across_x && x == first_.x()) slab_.lower.push_back({key, index});
    return index;
  }

  // Interpolates from the free end, so that every cell gets the same vertex.
  std::uint32_t NewVertex(int u, int v) {
    if (decomposition_.density[u] > decomposition_.density[v]) std::swap(u, v);
    const double low = decomposition_.density[u], high = decomposition_.density[v];
    const double share = (request_.isovalue - low) / (high - low);
    const Vec3 origin = cell_.cast<double>();
    const Vec3 from = origin + decomposition_.position[u];
    const Vec3 to = origin + decomposition_.position[v];
    if (slab_.vertices.size() >= kInUpperPlane) {
      throw Error(ErrorKind::kTooLarge, "the surface has more than 2^31 vertices");
    }
    slab_.vertices.push_back(from + share * (to - from));
    return static_cast<std::uint32_t>(slab_.vertices.size() - 1);
  }

  const SlabRequest& request_;
  const Vec3i first_, end_;
  const int vertices_y_, vertices_z_;
  // [0]: the lattice plane below the current layer of cells; [1]: the plane above.
  std::array<std::vector<std::uint8_t>, 2> above_;   // lattice vertices above τ
  std::array<std::vector<std::uint32_t>, 2> slots_;  // mesh vertices of shared edges
  Vec3i cell_ = Vec3i::Zero();
  Decomposition decomposition_;
  // Of every complex that was met; these are few.
  std::map<decltype(TetrahedralComplex::vertices), TetrahedronSigns> signs_;
  std::array<std::uint32_t, kMaxVertices * kMaxVertices> local_;
  MeshSlab slab_;
};

// Throws kTooLarge above 2³¹ vertices in a slab.
MeshSlab MakeSlab(const SlabRequest& request) { return SlabBuilder(request).Build(); }

// Layers of cells in a slab. Thin slabs keep all cores busy. The number is fixed, so that the mesh
// does not depend on the number of cores.
constexpr int kLayers = 4;

class Progress {
 public:
  Progress(const MeshProgress& progress, std::size_t steps) : progress_(progress), steps_(steps) {}

  void Step() {
    if (!progress_) return;
    const std::scoped_lock lock(mutex_);
    progress_(static_cast<double>(++done_) / static_cast<double>(steps_));
  }

 private:
  const MeshProgress& progress_;
  const std::size_t steps_;
  std::mutex mutex_;
  std::size_t done_ = 0;
};

std::uint32_t FindInLowerPlane(const MeshSlab& slab, std::uint64_t key) {
  const auto found =
      std::lower_bound(slab.lower.begin(), slab.lower.end(), key,
                       [](const PlaneVertex& l, std::uint64_t k) { return l.key < k; });
  // Both cells at a face decompose the face from the same four densities, so they must agree.
  if (found == slab.lower.end() || found->key != key) {
    throw Error(ErrorKind::kInternal, "neighbouring cells disagree on their common face");
  }
  return found->index;
}

// The first vertex and triangle of each slab in the whole mesh, and the totals.
struct Offsets {
  std::vector<std::size_t> vertices{0};
  std::vector<std::size_t> triangles{0};
};

Offsets MakeOffsets(const std::vector<MeshSlab>& slabs) {
  Offsets offsets;
  for (const MeshSlab& slab : slabs) {
    offsets.vertices.push_back(offsets.vertices.back() + slab.vertices.size());
    offsets.triangles.push_back(offsets.triangles.back() + slab.triangles.size());
  }
  if (offsets.vertices.back() >= std::size_t{1} << 31 ||
      offsets.triangles.back() > std::numeric_limits<std::uint32_t>::max() / 3) {
    throw Error(ErrorKind::kTooLarge, "the surface has too many triangles for one mesh");
  }
  return offsets;
}

// Copies slab n and numbers its vertices as in the whole mesh.
void CopySlab(const std::vector<MeshSlab>& slabs, std::size_t n, const Offsets& offsets,
              SurfaceMesh& mesh) {
  const MeshSlab& slab = slabs[n];
  std::copy(slab.vertices.begin(), slab.vertices.end(),
            mesh.vertices.begin() + static_cast<std::ptrdiff_t>(offsets.vertices[n]));
  std::vector<std::uint32_t> upper;
  upper.reserve(slab.upper.size());
  for (std::uint64_t key : slab.upper) {
    upper.push_back(
        static_cast<std::uint32_t>(offsets.vertices[n + 1] + FindInLowerPlane(slabs[n + 1], key)));
  }
  const auto first = static_cast<std::uint32_t>(offsets.vertices[n]);
  std::size_t at = offsets.triangles[n];
  for (const auto& triangle : slab.triangles) {
    for (int v = 0; v < 3; ++v) {
      const std::uint32_t index = triangle[v];
      mesh.triangles[at][v] = index & kInUpperPlane ? upper[index & ~kInUpperPlane] : first + index;
    }
    ++at;
  }
}

}  // namespace

SurfaceMesh ExtractSurface(const Lattice& lattice, double isovalue, ComparedMethod method,
                           const CellRange& range, const MeshProgress& progress) {
  const int layers = range.end.x() - range.first.x();
  std::vector<MeshSlab> slabs(static_cast<std::size_t>((layers + kLayers - 1) / kLayers));
  Progress report(progress, slabs.size());
  tbb::parallel_for(std::size_t{0}, slabs.size(), [&](std::size_t n) {
    SlabRequest request{lattice, isovalue, method, range, n + 1 < slabs.size()};
    request.range.first.x() += static_cast<int>(n) * kLayers;
    request.range.end.x() = std::min(request.range.first.x() + kLayers, range.end.x());
    slabs[n] = MakeSlab(request);
    report.Step();
  });

  const Offsets offsets = MakeOffsets(slabs);
  SurfaceMesh mesh;
  mesh.range = range;
  mesh.vertices.resize(offsets.vertices.back());
  mesh.triangles.resize(offsets.triangles.back());
  tbb::parallel_for(std::size_t{0}, slabs.size(),
                    [&](std::size_t n) { CopySlab(slabs, n, offsets, mesh); });
  return mesh;
}

}  // namespace palpate::lab
