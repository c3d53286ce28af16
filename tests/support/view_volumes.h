// Volumes for tests of the viewer, like those of the client library.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "client/sdk/volume_update.h"
#include "client/view/volume/view_volume.h"
#include "common/geometry/geometry.h"

namespace palpate::testing {

// Casts rays through a volume in double precision. The code is written only to be correct: the
// graphics card's pictures are compared with it.
//
// A ray is cut at every plane of the lattice. In each piece F is a cubic: the sum over the corners
// of products of three linear functions. F crosses the isovalue between the cubic's turning points.
//
// Frame: I (voxels). One layer of the background surrounds the lattice.

// Voxel (i, j, k) at (i size_y + j) size_z + k.
struct VoxelArray {
  Vec3i size = Vec3i::Zero();
  float background = 0.0f;
  std::vector<float> values{};

  float At(int i, int j, int k) const {
    if (i < 0 || j < 0 || k < 0 || i >= size.x() || j >= size.y() || k >= size.z()) {
      return background;
    }
    return values[(static_cast<std::size_t>(i) * size.y() + j) * size.z() + k];
  }
};

inline VoxelArray MakeVoxels(const Vec3i& size, const std::function<float(int, int, int)>& value) {
  VoxelArray voxels{size, 0.0f};
  for (int i = 0; i < size.x(); ++i) {
    for (int j = 0; j < size.y(); ++j) {
      for (int k = 0; k < size.z(); ++k) voxels.values.push_back(value(i, j, k));
    }
  }
  voxels.background = *std::min_element(voxels.values.begin(), voxels.values.end());
  return voxels;
}

// Keeps points p with normal . p <= offset. is_cut: false for the volume's own border.
struct HalfSpace {
  Vec3 normal = Vec3::Zero();
  double offset = 0.0;
  bool is_cut = true;
};

inline std::vector<HalfSpace> PaddedBox(const Vec3i& size) {
  std::vector<HalfSpace> faces;
  for (int a = 0; a < 3; ++a) {
    faces.push_back({-Vec3::Unit(a), 1.0, false});
    faces.push_back({Vec3::Unit(a), static_cast<double>(size[a]), false});
  }
  return faces;
}

class CpuCaster {
 public:
  CpuCaster(const VoxelArray& voxels, std::vector<HalfSpace> kept)
      : voxels_(voxels), kept_(std::move(kept)) {}

  struct Part {
    double from = 0.0;
    double to = 0.0;
    bool begins_outside = false;  // of the padded lattice
    bool begins_at_cut = false;
    bool ends_outside = false;
  };
  // Returns the part of origin + t direction, t >= 0, within all half-spaces.
  std::optional<Part> Kept(const Vec3& origin, const Vec3& direction) const {
    Part part{0.0, std::numeric_limits<double>::infinity()};
    for (const HalfSpace& half : kept_) {
      const double rate = half.normal.dot(direction);
      const double room = half.offset - half.normal.dot(origin);
      if (rate == 0.0) {
        if (room < 0.0) return {};
      } else if (rate > 0.0) {
        if (room / rate < part.to) part.ends_outside = !half.is_cut;
        part.to = std::min(part.to, room / rate);
      } else if (room / rate > part.from) {
        part.from = room / rate;
        part.begins_outside = !half.is_cut;
        part.begins_at_cut = half.is_cut;
      }
    }
    if (part.from >= part.to) return {};
    return part;
  }

  double Value(const Vec3& p) const { return Along(CellAt(p), p, Vec3::Zero())[0]; }

  bool BeginsAbove(const Vec3& origin, const Vec3& direction, const Part& part,
                   double isovalue) const {
    if (part.begins_outside) return voxels_.background > isovalue;
    return Value(origin + part.from * direction) > isovalue;
  }

  // Returns where F crosses the isovalue, ascending, at most `most` places. Outside the lattice F
  // is exactly the background, without rounding at the border.
  std::vector<double> Crossings(const Vec3& origin, const Vec3& direction, const Part& part,
                                double isovalue, std::size_t most) const {
    std::vector<double> found;
    bool above = BeginsAbove(origin, direction, part, isovalue);
    const std::vector<double> ends = Pieces(origin, direction, part.from, part.to);
    for (std::size_t n = 0; n + 1 < ends.size() && found.size() < most; ++n) {
      const double middle = 0.5 * (ends[n] + ends[n + 1]);
      const Vec3i cell = CellAt(origin + middle * direction);
      if (Uniform(cell, isovalue, above)) continue;
      std::array<double, 4> f = Along(cell, origin + ends[n] * direction, direction);
      f[0] -= isovalue;
      AddCrossings(f, ends[n], ends[n + 1] - ends[n], above, found);
    }
    if (part.ends_outside && above != (voxels_.background > isovalue)) found.push_back(part.to);
    if (found.size() > most) found.resize(most);
    return found;
  }

 private:
  using Cubic = std::array<double, 4>;

  static Vec3i CellAt(const Vec3& p) { return p.array().floor().cast<int>(); }

  bool Uniform(const Vec3i& c, double isovalue, bool above) const {
    for (int n = 0; n < 8; ++n) {
      const float v = voxels_.At(c.x() + (n >> 2), c.y() + (n >> 1 & 1), c.z() + (n & 1));
      if ((v > isovalue) != above) return false;
    }
    return true;
  }

  std::vector<double> Pieces(const Vec3& origin, const Vec3& direction, double from,
                             double to) const {
    std::vector<double> ends{from, to};
    for (int a = 0; a < 3; ++a) {
      if (direction[a] == 0.0) continue;
      for (int plane = -1; plane <= voxels_.size[a]; ++plane) {
        const double t = (plane - origin[a]) / direction[a];
        if (t > from && t < to) ends.push_back(t);
      }
    }
    std::sort(ends.begin(), ends.end());
    return ends;
  }

  // F of a cell along p + s d, as powers of s.
  Cubic Along(const Vec3i& cell, const Vec3& p, const Vec3& d) const {
    Cubic sum{};
    for (int n = 0; n < 8; ++n) {
      const std::array<int, 3> corner{n >> 2, n >> 1 & 1, n & 1};
      Cubic product{voxels_.At(cell.x() + corner[0], cell.y() + corner[1], cell.z() + corner[2])};
      for (int a = 0; a < 3; ++a) {
        const double u = p[a] - cell[a];
        const double at = corner[a] == 1 ? u : 1.0 - u;
        const double slope = corner[a] == 1 ? d[a] : -d[a];
        for (int power = 3; power > 0; --power) {
          product[power] = product[power] * at + product[power - 1] * slope;
        }
        product[0] *= at;
      }
      for (int power = 0; power < 4; ++power) sum[power] += product[power];
    }
    return sum;
  }

  static double At(const Cubic& f, double s) { return f[0] + s * (f[1] + s * (f[2] + s * f[3])); }

  static void AddCrossings(const Cubic& f, double t, double length, bool& above,
                           std::vector<double>& found) {
    std::vector<double> ends{0.0, length};
    const double root = std::sqrt(std::max(0.0, f[2] * f[2] - 3.0 * f[3] * f[1]));
    for (const double s : {(-f[2] + root) / (3.0 * f[3]), (-f[2] - root) / (3.0 * f[3]),
                           -f[1] / (f[2] + root), -f[1] / (f[2] - root)}) {
      if (s > 0.0 && s < length) ends.push_back(s);
    }
    std::sort(ends.begin(), ends.end());
    for (std::size_t n = 1; n < ends.size(); ++n) {
      if ((At(f, ends[n]) > 0.0) == above) continue;
      double low = ends[n - 1];
      double high = ends[n];
      for (int halving = 0; halving < 60; ++halving) {
        const double middle = 0.5 * (low + high);
        ((At(f, middle) > 0.0) == above ? low : high) = middle;
      }
      above = !above;
      found.push_back(t + high);
    }
  }

  const VoxelArray& voxels_;
  std::vector<HalfSpace> kept_;
};

// A brick in this type, or of floats if the type does not hold a value.
inline TypedBrickPtr BrickOf(const VoxelArray& voxels, const Vec3i& brick,
                             LeafType type = LeafType::kFloat) {
  Brick values;
  for (int n = 0; n < kBrickVoxels; ++n) {
    values[static_cast<std::size_t>(n)] =
        voxels.At(8 * brick.x() + (n >> 6), 8 * brick.y() + (n >> 3 & 7), 8 * brick.z() + (n & 7));
  }
  const auto holds = [&](float value) { return Holds(type, value); };
  if (!std::all_of(values.begin(), values.end(), holds)) type = LeafType::kFloat;
  const auto is_first = [&](float value) { return value == values.front(); };
  if (std::all_of(values.begin(), values.end(), is_first)) {
    return TypedBrick::Constant(type, values.front());
  }
  return VisitType(type, [&](auto voxel) {
    std::array<decltype(voxel), kBrickVoxels> typed;
    std::transform(values.begin(), values.end(), typed.begin(),
                   [](float value) { return static_cast<decltype(voxel)>(value); });
    return TypedBrick::Of<decltype(voxel)>(typed);
  });
}

// All bricks of `voxels`.
inline BrickMap BricksOf(const VoxelArray& voxels, LeafType type = LeafType::kFloat) {
  VolumeLattice lattice;
  lattice.size = voxels.size;
  BrickMap bricks(lattice.BrickCounts(), TypedBrick::Constant(LeafType::kFloat, voxels.background));
  for (std::uint64_t number = 0; number < lattice.Bricks(); ++number) {
    bricks.Put(number, BrickOf(voxels, BrickWithNumber(number, lattice.BrickCounts()), type));
  }
  return bricks;
}

// A complete volume.
inline client::VolumeUpdate WholeVolume(const VoxelArray& voxels, const AffineMap& X_DI,
                                        LeafType type = LeafType::kFloat) {
  client::VolumeUpdate update;
  update.all = true;
  VolumeLattice lattice;
  lattice.size = voxels.size;
  lattice.value_min = voxels.background;
  lattice.value_max = *std::max_element(voxels.values.begin(), voxels.values.end());
  lattice.type = type;
  update.lattice = lattice;
  update.placement.emplace().device_from_index = X_DI;
  update.bricks = BricksOf(voxels, type).Share();
  update.changed = {{0, lattice.Bricks()}};
  update.complete.emplace();
  return update;
}

// Some bricks of a volume become those of `voxels`.
inline client::VolumeUpdate Edit(const view::ViewVolume& volume, const VoxelArray& voxels,
                                 const std::vector<Vec3i>& bricks,
                                 LeafType type = LeafType::kFloat) {
  client::VolumeUpdate update;
  update.lattice = volume.lattice();
  update.placement.emplace().device_from_index = volume.X_DI().value();
  const Vec3i counts = update.lattice->BrickCounts();
  BrickMap map(counts, TypedBrick::Constant(LeafType::kFloat, update.lattice->Background()));
  map.CopyFrom(volume.bricks(), {0, map.size()});
  for (const Vec3i& brick : bricks) {
    map.Put(BrickNumber(brick, counts), BrickOf(voxels, brick, type));
    update.changed.push_back({BrickNumber(brick, counts), 1});
  }
  std::sort(update.changed.begin(), update.changed.end(),
            [](const BrickRun& a, const BrickRun& b) { return a.first < b.first; });
  update.bricks = map.Share();
  update.complete.emplace();
  return update;
}

// A volume from a function of I. Its range may be wider than the function's values. The background
// is the range's least value.
inline client::VolumeUpdate VolumeOf(const Vec3i& size,
                                     const std::function<double(const Vec3&)>& value,
                                     const AffineMap& X_DI, double min, double max) {
  VoxelArray voxels = MakeVoxels(
      size, [&](int i, int j, int k) { return static_cast<float>(value(Vec3(i, j, k))); });
  voxels.background = static_cast<float>(min);
  client::VolumeUpdate update = WholeVolume(voxels, X_DI);
  update.lattice->value_max = max;
  return update;
}

}  // namespace palpate::testing
