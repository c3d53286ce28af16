#include "server/simulated_hand/touch_points.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

namespace palpate {
namespace {

constexpr double kCloseEnough = 1e-4;  // density

}  // namespace

double SurfaceProbe::At(const Vec3& p_D_mm) { return AtIndex(surface_.X_ID.Apply(p_D_mm)); }

double SurfaceProbe::AtIndex(const Vec3& p_I) {
  ++reads_;
  const Vec3 floor_I = p_I.array().floor();
  const Vec3 beyond = surface_.volume->size().cast<double>();
  if ((floor_I.array() < -1.0).any() || (floor_I.array() >= beyond.array()).any()) {
    return surface_.DensityOutside() - surface_.isovalue;
  }
  const Vec3i cell = floor_I.cast<int>();
  if (cell != cell_) {
    cell_ = cell;
    densities_ = surface_.Felt(surface_.volume->StoredCell(cell));
  }
  const Vec3 u = p_I - floor_I;
  double density = 0.0;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    density += densities_[v] * (o[0] ? u.x() : 1.0 - u.x()) * (o[1] ? u.y() : 1.0 - u.y()) *
               (o[2] ? u.z() : 1.0 - u.z());
  }
  return density - surface_.isovalue;
}

Vec3 SurfaceProbe::GradientAt(const Vec3& p_D_mm) {
  constexpr double kHalfVoxels = 0.75;
  const Vec3 p_I = surface_.X_ID.Apply(p_D_mm);
  Vec3 gradient_I;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 off = kHalfVoxels * Vec3::Unit(axis);
    gradient_I[axis] = (AtIndex(p_I + off) - AtIndex(p_I - off)) / (2.0 * kHalfVoxels);
  }
  // A covector.
  return surface_.X_ID.linear.transpose() * gradient_I;
}

Vec3 SurfaceProbe::NormalAt(const Vec3& p_D_mm) {
  const Vec3 gradient = GradientAt(p_D_mm);
  const double size = gradient.norm();
  return size > 0.0 ? Vec3(-gradient / size) : Vec3(Vec3::Zero());
}

// Brackets the crossing along the line, so that noise cannot send the point far away.
bool SurfaceProbe::Project(Vec3& p_D_mm, const Vec3& normal_D, double reach_mm) {
  const Vec3 start = p_D_mm;
  const double first = At(start);
  const double sign = first > 0.0 ? 1.0 : -1.0;
  double near_mm = 0.0, near_value = sign * first;
  for (const double share : {0.2, 1.0}) {
    double far_mm = share * reach_mm;
    double far_value = sign * At(start + sign * far_mm * normal_D);
    if (far_value > 0.0) {
      near_mm = far_mm;
      near_value = far_value;
      continue;
    }
    // Regula falsi, with half a step where one end stands still.
    constexpr int kSteps = 4;
    for (int n = 0; n < kSteps; ++n) {
      const double middle_mm =
          near_mm + (far_mm - near_mm) * near_value / std::max(near_value - far_value, 1e-12);
      p_D_mm = start + sign * middle_mm * normal_D;
      const double value = sign * At(p_D_mm);
      if (std::abs(value) < kCloseEnough) break;
      if (value > 0.0) {
        near_mm = middle_mm;
        near_value = value;
        far_value *= 0.5;
      } else {
        far_mm = middle_mm;
        far_value = value;
        near_value *= 0.5;
      }
    }
    return true;
  }
  return false;
}

bool SurfaceProbe::IsInLattice(const Vec3& p_D_mm) const {
  const Vec3 p_I = surface_.X_ID.Apply(p_D_mm);
  return (p_I.array() >= -1.0).all() &&
         (p_I.array() <= surface_.volume->size().cast<double>().array()).all();
}

namespace {

constexpr double kSpareMm = 1.0;
constexpr int kMostPerLeaf = 16;

// Leaves of a box of the directory, each once, far apart one after the other.
class LeafOrder {
 public:
  LeafOrder(const Vec3i& low, const Vec3i& high) : low_(low), size_(high - low + Vec3i::Ones()) {
    if ((size_.array() <= 0).any()) return;
    count_ = size_.cast<std::int64_t>().prod();
    constexpr double kGolden = 0.6180339887498949;
    step_ = std::max<std::int64_t>(1, std::llround(kGolden * static_cast<double>(count_)));
    while (std::gcd(step_, count_) != 1) ++step_;
  }
  std::int64_t count() const { return count_; }
  Vec3i Next() {
    at_ = (at_ + step_) % count_;
    const std::int64_t rest = at_ / size_.z();
    return low_ + Vec3i(static_cast<int>(rest / size_.y()), static_cast<int>(rest % size_.y()),
                        static_cast<int>(at_ % size_.z()));
  }

 private:
  Vec3i low_, size_;
  std::int64_t count_ = 0, step_ = 1, at_ = 0;
};

// The leaves that the workspace meets.
LeafOrder LeavesWithin(const HapticSurface& surface, const DeviceDescription& device) {
  Eigen::AlignedBox3d box_I;
  for (int corner = 0; corner < 8; ++corner) {
    Vec3 p_D_mm;
    for (int axis = 0; axis < 3; ++axis) {
      p_D_mm[axis] = (corner >> axis & 1 ? device.workspace_max_mm : device.workspace_min_mm)[axis];
    }
    box_I.extend(surface.X_ID.Apply(p_D_mm));
  }
  const Vec3 last = (surface.volume->size() - Vec3i::Ones()).cast<double>();
  if ((box_I.min().array() > last.array() + 1.0).any() || (box_I.max().array() < -1.0).any()) {
    return {Vec3i::Zero(), -Vec3i::Ones()};
  }
  const auto leaf_of = [&](const Vec3& p_I) {
    const Vec3 voxel = p_I.cwiseMax(Vec3::Zero()).cwiseMin(last);
    return Vec3i(voxel.cast<int>() / kBrickEdge);
  };
  return {leaf_of(box_I.min()), leaf_of(box_I.max())};
}

class Finder {
 public:
  Finder(const HapticSurface& surface, const DeviceDescription& device)
      : surface_(surface),
        device_(device),
        probe_(surface),
        threshold_(surface.volume->Denormalize(surface.sign() * surface.isovalue)) {}

  // Up to `most` points of the leaf. False where its voxels need not be read.
  bool Look(const Vec3i& brick, std::uint64_t turn, int most, std::vector<SurfacePoint>& points) {
    const Leaf& leaf = *surface_.volume->bricks().At(brick);
    const bool crosses = !leaf.is_constant() && Crosses(leaf);
    if (!crosses && !DiffersFromNeighbours(brick)) return !leaf.is_constant();
    // Somewhere else in each leaf, so that no corner of the bricks is preferred.
    std::size_t voxel = turn * 197 % kBrickVoxels;
    for (int n = 0; n < most; ++n) {
      const std::optional<SurfacePoint> point = PointFrom(kBrickEdge * brick, voxel);
      if (point && IsWithinReach(device_, point->p_D_mm)) points.push_back(*point);
      voxel = (voxel + kBrickVoxels / most) % kBrickVoxels;
    }
    return true;
  }
  std::int64_t reads() const { return probe_.reads(); }

 private:
  bool Crosses(const Leaf& leaf) const {
    return VisitType(leaf.type(), [&](auto type) {
      const auto* const values = leaf.values<decltype(type)>();
      auto low = values[0], high = values[0];
      for (std::size_t n = 1; n < kBrickVoxels; ++n) {
        low = std::min(low, values[n]);
        high = std::max(high, values[n]);
      }
      return static_cast<double>(low) <= threshold_ && static_cast<double>(high) >= threshold_;
    });
  }

  // Two leaves of one value each, and the lattice's border, have surface between them.
  bool DiffersFromNeighbours(const Vec3i& brick) const {
    const Vec3i voxel = kBrickEdge * brick;
    const bool is_material = FeltAt(voxel) > 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, kBrickEdge}) {
        if ((FeltAt(voxel + step * Vec3i::Unit(axis)) > 0.0) != is_material) return true;
      }
    }
    return false;
  }

  double FeltAt(const Vec3i& vertex) const {
    return surface_.sign() * surface_.volume->StoredVertex(vertex) - surface_.isovalue;
  }

  // On the first crossed edge from voxel number `voxel` on, where there is one.
  std::optional<SurfacePoint> PointFrom(const Vec3i& corner, std::size_t& voxel) {
    for (std::size_t n = 0; n < kBrickVoxels; ++n, voxel = (voxel + 1) % kBrickVoxels) {
      const int number = static_cast<int>(voxel);
      const Vec3i inside = corner + Vec3i(number >> 6, number >> 3 & 7, number & 7);
      const double above = FeltAt(inside);
      if (above <= 0.0) continue;
      for (int side = 0; side < 6; ++side) {
        const Vec3i way = (side & 1 ? 1 : -1) * Vec3i::Unit((side + number) / 2 % 3);
        const double below = FeltAt(inside + way);
        if (below > 0.0) continue;
        const Vec3 p_I = inside.cast<double>() + above / (above - below) * way.cast<double>();
        const Vec3 p_D_mm = surface_.X_DI.Apply(p_I);
        const Vec3 normal = probe_.NormalAt(p_D_mm);
        if (!normal.isZero()) return SurfacePoint{p_D_mm, normal};
      }
    }
    return std::nullopt;
  }

  const HapticSurface& surface_;
  const DeviceDescription& device_;
  SurfaceProbe probe_;
  double threshold_;  // data units
};

}  // namespace

bool IsWithinReach(const DeviceDescription& device, const Vec3& p_D_mm) {
  return (p_D_mm.array() >= device.workspace_min_mm.array() + kSpareMm).all() &&
         (p_D_mm.array() <= device.workspace_max_mm.array() - kSpareMm).all();
}

std::vector<Vec3> FindFreePlaces(const HapticSurface& surface, const DeviceDescription& device) {
  constexpr double kApartMm = 8.0;
  constexpr double kOffMm = 4.0;
  SurfaceProbe probe(surface);
  std::vector<Vec3> outside_mm, within_mm;
  const auto look_at = [&](const Vec3& p_D_mm) {
    bool is_in_lattice = false;
    for (int n = 0; n < 7; ++n) {
      const Vec3 off_mm =
          n == 6 ? Vec3(Vec3::Zero()) : Vec3((n % 2 ? kOffMm : -kOffMm) * Vec3::Unit(n / 2));
      if (probe.IsMaterial(p_D_mm + off_mm)) return;
      is_in_lattice |= probe.IsInLattice(p_D_mm + off_mm);
    }
    (is_in_lattice ? within_mm : outside_mm).push_back(p_D_mm);
  };
  const Vec3 low_mm = device.workspace_min_mm.array() + 2.0 * kSpareMm;
  const Vec3 high_mm = device.workspace_max_mm.array() - 2.0 * kSpareMm;
  const Vec3i count = ((high_mm - low_mm) / kApartMm).array().ceil().cast<int>().max(1);
  for (int i = 0; i <= count.x(); ++i) {
    for (int j = 0; j <= count.y(); ++j) {
      for (int k = 0; k <= count.z(); ++k) {
        const Vec3 share = Vec3(i, j, k).cwiseQuotient(count.cast<double>());
        look_at(low_mm + share.cwiseProduct(high_mm - low_mm));
      }
    }
  }
  return outside_mm.empty() ? within_mm : outside_mm;
}

std::vector<SurfacePoint> FindTouchPoints(const HapticSurface& surface,
                                          const DeviceDescription& device,
                                          const GuideBudget& budget, GuideCost& cost) {
  LeafOrder order = LeavesWithin(surface, device);
  std::vector<SurfacePoint> points;
  cost = {};
  if (order.count() == 0) return points;
  const auto most = static_cast<int>(
      std::clamp<std::int64_t>(4 * budget.points / order.count(), 1, kMostPerLeaf));
  Finder finder(surface, device);
  const std::int64_t places = std::min(order.count(), budget.places);
  for (; cost.places < places && cost.leaves < budget.leaves; ++cost.places) {
    if (static_cast<int>(points.size()) >= budget.points) break;
    const auto turn = static_cast<std::uint64_t>(cost.places);
    cost.leaves += finder.Look(order.Next(), turn, most, points);
  }
  cost.reads = finder.reads();
  return points;
}

}  // namespace palpate
