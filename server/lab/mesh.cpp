#include "server/lab/mesh.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <mutex>

#include "common/error/error.h"
#include "server/lab/mesh_slab.h"

namespace palpate::lab {
namespace {

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
