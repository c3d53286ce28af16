#include "server/volume/edit/reshape.h"

#include <fmt/core.h>
#include <openvdb/tools/GridTransformer.h>
#include <openvdb/tools/LevelSetFilter.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <utility>

#include "common/error/error.h"
#include "server/volume/edit/filter_interrupter.h"
#include "server/volume/load/handover.h"
#include "server/volume/snapshot/grid_tree.h"
#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {
namespace {

using Grid = openvdb::FloatGrid;
using Node = Grid::TreeType::LeafNodeType;
// The instance that the library compiles.
using LevelSetFilter = openvdb::tools::LevelSetFilter<Grid, Grid, openvdb::util::NullInterrupter>;

constexpr int kMostIterations = 1000;
constexpr double kMostOffsetVoxels = 128.0;
constexpr double kMostEdge = 1 << 30;  // voxels
// Bricks between two reports of progress.
constexpr std::uint64_t kBricksPerReport = 1 << 12;
// Relative difference up to which two sides of a voxel count as equal.
constexpr double kAlike = 1e-6;
// A filtered tree has two more buffers for each leaf, and grows by one layer at a time.
constexpr std::uint64_t kLevelSetCopies = 4;
// For the tree, a temporary coarser tree, and the bricks.
constexpr double kResampledCopies = 3.0;

Vec3i ToVec(const openvdb::Coord& at) { return {at.x(), at.y(), at.z()}; }

bool IsUniform(const Vec3& spacing_mm) {
  return spacing_mm.maxCoeff() - spacing_mm.minCoeff() <= kAlike * spacing_mm.maxCoeff();
}

void CheckLevelSet(const VolumeMetadata& metadata, const VolumeFilter& filter) {
  if (!metadata.is_level_set || !metadata.grid_form) {
    Refuse("the volume is not a level set: offset and mean-curvature are for level sets only");
  }
  if (!IsUniform(metadata.spacing_mm)) {
    Refuse("the voxels are not cubes: resample the volume to one spacing first");
  }
  if (filter.iterations < 1 || filter.iterations > kMostIterations) {
    Refuse(fmt::format("{} iterations are not possible: give 1 to {}", filter.iterations,
                       kMostIterations));
  }
  if (filter.kind != FilterKind::kOffset) return;
  const double most_mm = kMostOffsetVoxels * metadata.spacing_mm.x();
  if (!std::isfinite(filter.distance_mm) || filter.distance_mm == 0.0 ||
      std::abs(filter.distance_mm) > most_mm) {
    Refuse(
        fmt::format("the distance {} mm is not possible: give one other than 0, and at most {} "
                    "mm ({} voxels)",
                    filter.distance_mm, most_mm, kMostOffsetVoxels));
  }
}

// The size of a lattice with this spacing that covers the same voxel centres.
Vec3 ResampledSize(const VolumeMetadata& metadata, const Vec3& spacing_mm) {
  constexpr double kRounding = 1e-9;  // of a voxel
  const Vec3 extent_mm =
      (metadata.size.cast<double>() - Vec3::Ones()).cwiseProduct(metadata.spacing_mm);
  return (extent_mm.cwiseQuotient(spacing_mm).array() + 1.0 + kRounding).floor();
}

void CheckSpacing(const VolumeMetadata& metadata, const VolumeFilter& filter) {
  const Vec3& spacing_mm = filter.spacing_mm;
  if (!spacing_mm.allFinite() || spacing_mm.minCoeff() < kLeastSpacingMm ||
      spacing_mm.maxCoeff() > kGreatestSpacingMm) {
    Refuse(
        fmt::format("the spacing is not within {} to {} mm", kLeastSpacingMm, kGreatestSpacingMm));
  }
  if (metadata.is_level_set && !(IsUniform(spacing_mm) && IsUniform(metadata.spacing_mm))) {
    Refuse("a level set has voxels that are cubes: give one spacing for all axes");
  }
  const Vec3 size = ResampledSize(metadata, spacing_mm);
  if (size.minCoeff() < 2.0) {
    Refuse("with this spacing there would be less than 2 voxels along an axis: give a smaller one");
  }
  if (size.prod() > static_cast<double>(kMostLatticeVoxels) || size.maxCoeff() > kMostEdge) {
    throw Error(ErrorKind::kTooLarge, fmt::format("with this spacing there would be more than {} "
                                                  "voxels: give a larger one",
                                                  kMostLatticeVoxels));
  }
}

void Check(const VolumeMetadata& metadata, const VolumeFilter& filter) {
  if (!std::holds_alternative<std::monostate>(filter.region)) {
    Refuse("this filter is one of whole volumes: give no box and no sphere");
  }
  if (filter.kind == FilterKind::kResample) {
    CheckSpacing(metadata, filter);
  } else {
    CheckLevelSet(metadata, filter);
  }
}

double BricksOf(const Vec3i& size) {
  return ((size.cast<double>().array() + (kBrickEdge - 1)) / kBrickEdge).floor().prod();
}

// Makes bricks from a tree. The tree's voxel `first` becomes voxel (0, 0, 0) of the lattice.
class BrickMaker {
 public:
  // keeps_states: true for a volume from a grid, whose states matter. Otherwise every voxel is
  // active, and all voxels beyond `size` are background.
  BrickMaker(const Grid& grid, const Vec3i& first, const Vec3i& size, bool keeps_states)
      : accessor_(grid.getConstAccessor()),
        background_(grid.background()),
        first_(first),
        size_(size),
        keeps_states_(keeps_states) {}

  void HoldWithin(double least, double greatest) {
    least_ = static_cast<float>(least);
    greatest_ = static_cast<float>(greatest);
  }

  LeafPtr Make(const Vec3i& brick) {
    const Vec3i corner = first_ + kBrickEdge * brick;
    const openvdb::Coord at(corner.x(), corner.y(), corner.z());
    const Node* const node = accessor_.probeConstLeaf(at);
    if (!node) return Constant(Held(accessor_.getValue(at)), accessor_.isValueOn(at));
    auto held = std::make_unique<Node>(*node);
    float* const values = held->buffer().data();
    for (int n = 0; n < kBrickVoxels; ++n) values[n] = Held(values[n]);
    if (keeps_states_) return Leaf::Take<float>(std::move(held));
    Clip(brick, values);
    if (std::all_of(values, values + kBrickVoxels, [&](float v) { return v == values[0]; })) {
      return Constant(values[0], true);
    }
    Brick brick_values;
    std::copy_n(values, kBrickVoxels, brick_values.begin());
    return Leaf::Smallest(brick_values);
  }

  // The range of all bricks made.
  double least_made() const { return least_made_; }
  double greatest_made() const { return greatest_made_; }

 private:
  float Held(float value) {
    value = std::clamp(value, least_, greatest_) + 0.0f;
    least_made_ = std::min(least_made_, value);
    greatest_made_ = std::max(greatest_made_, value);
    return value;
  }

  void Clip(const Vec3i& brick, float* values) const {
    const Vec3i end = size_ - kBrickEdge * brick;
    if (end.minCoeff() >= kBrickEdge) return;
    for (int n = 0; n < kBrickVoxels; ++n) {
      if (n >> 6 < end.x() && (n >> 3 & 7) < end.y() && (n & 7) < end.z()) continue;
      values[n] = background_;
    }
  }

  LeafPtr Constant(float value, bool is_active) {
    LeafPtr& leaf = constants_[{value, is_active || !keeps_states_}];
    if (!leaf) {
      const LeafType type = keeps_states_ ? LeafType::kFloat : SmallestType(value);
      leaf = Leaf::Constant(type, value, is_active || !keeps_states_);
    }
    return leaf;
  }
  static LeafType SmallestType(float value) {
    Brick values;
    values.fill(value);
    return Leaf::Smallest(values)->type();
  }

  Grid::ConstAccessor accessor_;
  const float background_;
  const Vec3i first_;
  const Vec3i size_;
  const bool keeps_states_;
  float least_ = std::numeric_limits<float>::lowest();
  float greatest_ = std::numeric_limits<float>::max();
  float least_made_ = std::numeric_limits<float>::max();
  float greatest_made_ = std::numeric_limits<float>::lowest();
  std::map<std::pair<float, bool>, LeafPtr> constants_;
};

class Reshaper {
 public:
  Reshaper(const VolumeSnapshot& volume, const VolumeFilter& filter,
           const std::function<void(std::uint64_t)>& needs, const FilterProgress& progress,
           const FilterCancelled& cancelled)
      : volume_(volume),
        filter_(filter),
        needs_(needs),
        progress_(progress),
        interrupter_(cancelled),
        form_(volume.metadata().grid_form.get()),
        first_(form_ ? form_->first : Vec3i::Zero()) {}

  ReshapedVolume Resample() {
    const VolumeMetadata& before = volume_.metadata();
    VolumeMetadata metadata = before;
    metadata.spacing_mm = filter_.spacing_mm;
    metadata.size = ResampledSize(before, filter_.spacing_mm).cast<int>();
    ClaimFor(metadata);
    const Grid::Ptr in = MadeGrid();
    const float background =
        before.is_level_set
            ? static_cast<float>(in->background() * metadata.spacing_mm.x() / before.spacing_mm.x())
            : in->background();
    const Grid::Ptr out = Grid::create(background);
    out->setGridClass(in->getGridClass());
    openvdb::Mat4R map = openvdb::Mat4R::identity();
    for (int axis = 0; axis < 3; ++axis) {
      map[axis][axis] = metadata.spacing_mm[axis];
      map[3][axis] = before.spacing_mm[axis] * first_[axis];
    }
    out->setTransform(openvdb::math::Transform::createLinearTransform(map));
    // Uses only the sampler and interrupter that the library was compiled with: the rest of the
    // header does not compile in C++20.
    openvdb::util::NullInterrupter& interrupter = interrupter_;
    openvdb::tools::resampleToMatch<openvdb::tools::BoxSampler>(*in, *out, interrupter);
    progress_(kResampleShare);
    first_ = Vec3i::Zero();
    if (form_) GrowTo(*out, metadata);
    if (form_) metadata.grid_form = FormOf(out->background());
    return Made(*out, std::move(metadata));
  }

  ReshapedVolume FilterLevelSet() {
    ClaimLeaves(CountBricks().leaves);
    const Grid::Ptr grid = MadeGrid();
    LevelSetFilter filter(*grid, &interrupter_);
    if (filter_.kind == FilterKind::kOffset) {
      Offset(*grid, filter);
    } else {
      for (int n = 0; n < filter_.iterations; ++n) {
        ClaimLeaves(grid->tree().leafCount());
        filter.meanCurvature();
        progress_(kFilterShare * (n + 1) / filter_.iterations);
      }
    }
    VolumeMetadata metadata = volume_.metadata();
    if (GrowTo(*grid, metadata)) {
      auto form = std::make_shared<GridForm>(*form_);
      form->first = first_;
      // The outer leaves are within the new lattice, and so are bricks now.
      form->outer_leaves.clear();
      metadata.grid_form = std::move(form);
    }
    return Made(*grid, std::move(metadata));
  }

 private:
  // Shares of the progress; the rest is for making bricks.
  static constexpr double kFilterShare = 0.9;
  static constexpr double kResampleShare = 0.5;

  Grid::Ptr MadeGrid() const {
    const VolumeMetadata& metadata = volume_.metadata();
    const Grid::Ptr grid = MakeGrid<Grid>(LeavesOf(volume_.bricks()), metadata);
    openvdb::Mat4R map = openvdb::Mat4R::identity();
    for (int axis = 0; axis < 3; ++axis) map[axis][axis] = metadata.spacing_mm[axis];
    grid->setTransform(openvdb::math::Transform::createLinearTransform(map));
    if (metadata.is_level_set) grid->setGridClass(openvdb::GRID_LEVEL_SET);
    return grid;
  }

  struct Bricks {
    std::uint64_t leaves = 0;  // leaves with their own voxels
    std::uint64_t alike = 0;   // leaves of one value other than the background
  };
  Bricks CountBricks() {
    Bricks found;
    const auto background = static_cast<float>(volume_.metadata().Background());
    const Vec3i& count = volume_.bricks().brick_count();
    Vec3i b;
    for (b.x() = 0; b.x() < count.x(); ++b.x()) {
      for (b.y() = 0; b.y() < count.y(); ++b.y()) {
        interrupter_.wasInterrupted();
        for (b.z() = 0; b.z() < count.z(); ++b.z()) {
          const Leaf& leaf = *volume_.bricks().At(b);
          if (!leaf.is_constant()) {
            ++found.leaves;
          } else {
            found.alike += leaf[0] != background;
          }
        }
      }
    }
    return found;
  }

  void ClaimLeaves(std::uint64_t leaves) const {
    needs_(kLevelSetCopies * Leaf::Bytes(LeafType::kFloat) * (leaves + 1));
  }

  // Each brick may end up in several new bricks, but all of them fit into the lattice plus a
  // margin. A level set is made from its surface.
  void ClaimFor(const VolumeMetadata& after) {
    const Bricks bricks = CountBricks();
    const Vec3 finer = volume_.metadata().spacing_mm.cwiseQuotient(after.spacing_mm);
    const bool is_level_set = after.is_level_set;
    const auto leaves = static_cast<double>(bricks.leaves);
    const double sampled = leaves + (is_level_set ? 0.0 : static_cast<double>(bricks.alike));
    const double made = std::min((sampled + 1.0) * (finer.array().ceil() + 1.0).prod(),
                                 BricksOf(after.size + Vec3i::Constant(2 * kBrickEdge)));
    const double copies = is_level_set ? static_cast<double>(kLevelSetCopies) : kResampledCopies;
    needs_(static_cast<std::uint64_t>((leaves + copies * made) *
                                      static_cast<double>(Leaf::Bytes(LeafType::kFloat))) +
           BrickDirectory::BlockBytes(Vec3i::Zero(), (after.size - Vec3i::Ones()) / kBrickEdge));
  }

  // Works like LevelSetFilter::offset, in steps of at most half a voxel.
  void Offset(const Grid& grid, LevelSetFilter& filter) const {
    const float step = 0.5f * static_cast<float>(grid.voxelSize()[0]);
    // Moving the surface outwards lowers the values.
    const auto wanted = static_cast<float>(-filter_.distance_mm);
    const float distance = std::abs(wanted);
    for (float done = 0.0f; distance - done > 0.001f * step;) {
      ClaimLeaves(grid.tree().leafCount());
      const float next = std::min(distance - done, step);
      filter.offset(std::copysign(next, wanted));
      done += next;
      progress_(kFilterShare * static_cast<double>(done / distance));
    }
  }

  // Makes the lattice large enough for all active voxels. Returns false if it was already.
  bool GrowTo(const Grid& grid, VolumeMetadata& metadata) {
    const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
    if (active.empty()) return false;
    const Vec3i low = first_.cwiseMin(ToVec(active.min()));
    const Vec3i end = (first_ + metadata.size).cwiseMax(ToVec(active.max()) + Vec3i::Ones());
    const Vec3i first = low.unaryExpr([](int n) { return n & -kBrickEdge; });
    const Vec3i size = (end - first + Vec3i::Constant(kBrickEdge - 1)) / kBrickEdge * kBrickEdge;
    if (first == first_ && size == metadata.size) return false;
    if (size.cast<double>().prod() > static_cast<double>(kMostLatticeVoxels)) {
      throw Error(ErrorKind::kTooLarge,
                  "the result would have more voxels than a volume may have: give a smaller "
                  "distance or a "
                  "larger spacing");
    }
    metadata.origin_W_mm = metadata.WorldFromIndex().Apply((first - first_).cast<double>());
    metadata.size = size;
    first_ = first;
    return true;
  }

  // Keeps the rest of the grid's form, except for the positions of its tiles and nodes.
  std::shared_ptr<const GridForm> FormOf(float background) const {
    auto form = std::make_shared<GridForm>();
    form->first = first_;
    form->type = form_->type;
    form->background = background;
    form->entries = form_->entries;
    return form;
  }

  ReshapedVolume Made(const Grid& grid, VolumeMetadata metadata) {
    const bool has_new_range = metadata.is_level_set && filter_.kind == FilterKind::kResample;
    BrickMaker maker(grid, first_, metadata.size, form_ != nullptr);
    const auto [least, greatest] = metadata.EditRange();
    if (!has_new_range) maker.HoldWithin(least, greatest);
    const double begun = filter_.kind == FilterKind::kResample ? kResampleShare : kFilterShare;
    const double all = BricksOf(metadata.size);
    std::uint64_t done = 0;
    BrickDirectory bricks(metadata.size, [&](const Vec3i& brick) {
      if (done % kBricksPerReport == 0) {
        interrupter_.wasInterrupted();
        progress_(begun + (1.0 - begun) * static_cast<double>(done) / all);
      }
      ++done;
      return maker.Make(brick);
    });
    if (metadata.is_level_set && !(maker.least_made() < 0.0 && maker.greatest_made() > 0.0)) {
      Refuse(
          "nothing would be left of the surface: give a smaller distance, fewer iterations or a "
          "finer spacing");
    }
    if (has_new_range) {
      metadata.value_min = maker.least_made();
      metadata.value_max = std::max<double>(maker.greatest_made(), grid.background());
    }
    metadata.reloadable = false;
    CheckVolumeMetadata(metadata);
    progress_(1.0);
    return {std::move(metadata), std::move(bricks)};
  }

  const VolumeSnapshot& volume_;
  const VolumeFilter& filter_;
  const std::function<void(std::uint64_t)>& needs_;
  const FilterProgress& progress_;
  FilterInterrupter interrupter_;
  const GridForm* const form_;
  Vec3i first_;  // the lattice's first voxel, in the grid
};

}  // namespace

bool IsReshape(FilterKind kind) {
  return kind == FilterKind::kOffset || kind == FilterKind::kMeanCurvature ||
         kind == FilterKind::kResample;
}

ReshapedVolume Reshape(const VolumeSnapshot& volume, const VolumeFilter& filter,
                       const std::function<void(std::uint64_t bytes)>& needs,
                       const FilterProgress& progress, const FilterCancelled& cancelled) {
  Check(volume.metadata(), filter);
  Reshaper reshaper(volume, filter, needs, progress, cancelled);
  // OpenVDB uses all processors. This arena limits it to one.
  tbb::task_arena arena(1);
  return arena.execute([&] {
    return filter.kind == FilterKind::kResample ? reshaper.Resample() : reshaper.FilterLevelSet();
  });
}

}  // namespace palpate
