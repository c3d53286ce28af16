// A volume as a plain array of voxels beside the map of bricks that a client has of it. For tests
// that judge what is made of the map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "client/sdk/volume_update.h"
#include "common/bricks/brick_map.h"

namespace palpate {

class PlainVolume {
 public:
  PlainVolume(const Vec3i& size, LeafType type, float background)
      : background_(background),
        background_type_(Holds(type, background) ? type : LeafType::kFloat) {
    lattice_.size = size;
    lattice_.type = type;
    lattice_.background = background;
    lattice_.value_max = 255.0;
    const TypedBrickPtr brick = TypedBrick::Constant(background_type_, background);
    map_ = BrickMap(lattice_.BrickCounts(), brick);
    voxels_.assign(size.cast<std::size_t>().prod(), background);
    types_.assign(map_.size(), background_type_);
    update_.all = true;
  }

  const VolumeLattice& lattice() const { return lattice_; }
  const Vec3i& size() const { return lattice_.size; }
  float background() const { return background_; }
  std::uint64_t bricks() const { return map_.size(); }

  float Value(const Vec3i& v) const {
    if ((v.array() >= size().array()).any()) return background_;
    return voxels_[Place(v)];
  }
  // The smallest type that holds all bricks and the background.
  LeafType Type() const {
    LeafType type = background_type_;
    for (const LeafType one : types_) type = CommonType(type, one);
    return type;
  }

  // Sets the voxels of a brick; value(): of each voxel, which `type` must hold.
  template <class Next>
  void SetBrick(std::uint64_t number, LeafType type, Next value) {
    VisitType(type, [&](auto voxel) {
      std::vector<decltype(voxel)> values(kBrickVoxels);
      ForEachVoxel(number, [&](const Vec3i& v, std::size_t at) {
        const bool is_within = (v.array() < size().array()).all();
        const float set = is_within ? value() : background_;
        if (is_within) voxels_[Place(v)] = set;
        values[at] = static_cast<decltype(voxel)>(set);
      });
      Put(number, TypedBrick::Of(std::span<const decltype(voxel), kBrickVoxels>(values)));
    });
  }
  // A brick that lies within the lattice, or the background.
  void SetConstant(std::uint64_t number, LeafType type, float value) {
    ForEachVoxel(number, [&](const Vec3i& v, std::size_t) {
      if ((v.array() < size().array()).all()) voxels_[Place(v)] = value;
    });
    Put(number, TypedBrick::Constant(type, value));
  }
  // One object for a run of bricks within the lattice.
  void Fill(BrickRun run, LeafType type, float value) {
    for (std::uint64_t n = run.first; n < run.end(); ++n) SetConstant(n, type, value);
    map_.Fill(run, TypedBrick::Constant(type, value));
  }

  // All changes since the last one, as a complete copy.
  client::VolumeUpdate Take() {
    client::VolumeUpdate taken = std::exchange(update_, {});
    taken.lattice = lattice_;
    taken.bricks = map_.Share();
    Join(taken.changed);
    taken.complete = VolumeRevision{7, ++revision_};
    taken.content_hash = {revision_, 5};
    return taken;
  }

 private:
  std::size_t Place(const Vec3i& v) const {
    return (static_cast<std::size_t>(v.x()) * size().y() + v.y()) * size().z() + v.z();
  }
  template <class Visit>
  void ForEachVoxel(std::uint64_t number, Visit visit) const {
    const Vec3i first = BrickWithNumber(number, map_.brick_count()) * kBrickEdge;
    for (int n = 0; n < kBrickVoxels; ++n) {
      visit(first + Vec3i(n >> 6, n >> 3 & 7, n & 7), static_cast<std::size_t>(n));
    }
  }
  void Put(std::uint64_t number, const TypedBrickPtr& brick) {
    map_.Put(number, brick);
    types_[number] = brick->type();
    update_.changed.push_back({number, 1});
  }

  VolumeLattice lattice_;
  const float background_;
  const LeafType background_type_;
  BrickMap map_;
  std::vector<float> voxels_;
  std::vector<LeafType> types_;
  client::VolumeUpdate update_;
  std::uint64_t revision_ = 0;
};

}  // namespace palpate
