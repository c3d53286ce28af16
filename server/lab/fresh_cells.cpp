#include "server/lab/fresh_cells.h"

#include <algorithm>
#include <limits>

namespace palpate::lab {
namespace {

constexpr std::size_t kMostCells = 50'000;

// Barycentric weights, as ratios of signed volumes.
std::array<double, 4> WeightsOf(const std::array<Vec3, 4>& corner, const Vec3& p) {
  const Vec3 a = corner[1] - corner[0], b = corner[2] - corner[0], c = corner[3] - corner[0];
  const Vec3 q = p - corner[0];
  const Vec3 b_x_c = b.cross(c);
  const double volume = a.dot(b_x_c);
  std::array<double, 4> weight{};
  weight[1] = q.dot(b_x_c) / volume;
  weight[2] = q.dot(c.cross(a)) / volume;
  weight[3] = q.dot(a.cross(b)) / volume;
  weight[0] = 1.0 - weight[1] - weight[2] - weight[3];
  return weight;
}

double LeastWeight(const Holder& holder) {
  return *std::min_element(holder.weight.begin(), holder.weight.end());
}

}  // namespace

double Holders::Density() const {
  if (tetrahedra.empty()) {
    return outside ? density_outside : std::numeric_limits<double>::quiet_NaN();
  }
  return std::max_element(
             tetrahedra.begin(), tetrahedra.end(),
             [](const Holder& a, const Holder& b) { return LeastWeight(a) < LeastWeight(b); })
      ->density;
}

FreshCells::FreshCells(const HapticSurface& surface) : surface_(surface) {}

std::uint64_t FreshCells::KeyOf(const Vec3i& cell) const {
  const Vec3i count = surface_.lattice.size() + Vec3i::Ones();
  const auto at = (cell + Vec3i::Ones()).cast<std::uint64_t>();
  return (at.x() * static_cast<std::uint64_t>(count.y()) + at.y()) *
             static_cast<std::uint64_t>(count.z()) +
         at.z();
}

void FreshCells::Trim() {
  if (cells_.size() > kMostCells) cells_.clear();
}

const FreshCell& FreshCells::At(const Vec3i& cell) {
  const auto [found, is_new] = cells_.try_emplace(KeyOf(cell));
  FreshCell& fresh = found->second;
  if (is_new) {
    const CellDensities d = surface_.lattice.ResolvedCell(cell);
    fresh.parts = Decompose(d, surface_.method);
    const auto free = std::count_if(d.begin(), d.end(), [&](double each) { return IsFree(each); });
    fresh.free = free == 8;
    fresh.crossed = free != 8 && HasFreePart(d);
  }
  return fresh;
}

std::array<Vec3, 4> CornersOf(const Vec3i& cell, const FreshCell& fresh, int tetrahedron) {
  std::array<Vec3, 4> corners;
  for (int n = 0; n < 4; ++n) {
    const int vertex = fresh.parts.complex.vertices[tetrahedron][n];
    corners[n] = cell.cast<double>() + fresh.parts.position[vertex];
  }
  return corners;
}

std::array<double, 4> DensitiesOf(const FreshCell& fresh, int tetrahedron) {
  std::array<double, 4> densities{};
  for (int n = 0; n < 4; ++n) {
    densities[n] = fresh.parts.density[fresh.parts.complex.vertices[tetrahedron][n]];
  }
  return densities;
}

Holders FreshCells::HoldersOf(const Vec3& p_L) {
  Holders holders;
  holders.density_outside = surface_.volume->BackgroundDensity();
  const Vec3 last = surface_.lattice.size().cast<double>();
  const auto margin = Vec3::Constant(kHoldTolerance).array();
  holders.outside =
      (p_L.array() <= -1.0 + margin).any() || (p_L.array() >= last.array() - margin).any();
  // This check also keeps the cells' numbers representable.
  if ((p_L.array() < -1.0 - margin).any() || (p_L.array() > last.array() + margin).any()) {
    return holders;
  }
  const Vec3i low = (p_L.array() - margin).floor().matrix().cast<int>();
  const Vec3i high = (p_L.array() + margin).floor().matrix().cast<int>();
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        const Vec3i cell(x, y, z);
        if (!HasCell(cell)) continue;
        const FreshCell& fresh = At(cell);
        for (int t = 0; t < fresh.parts.complex.tetrahedron_count; ++t) {
          Holder holder{.cell = cell, .tetrahedron = t};
          holder.weight = WeightsOf(CornersOf(cell, fresh, t), p_L);
          if (!(LeastWeight(holder) >= -kHoldTolerance)) continue;
          const std::array<double, 4> densities = DensitiesOf(fresh, t);
          for (int n = 0; n < 4; ++n) holder.density += holder.weight[n] * densities[n];
          holders.tetrahedra.push_back(holder);
        }
      }
    }
  }
  return holders;
}

}  // namespace palpate::lab
