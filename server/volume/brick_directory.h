// The voxels of a volume: bricks of 8³ floats, as OpenVDB's leaves have them,
// each with the volume revision at which it changed last.
//
// A directory never changes; a change makes a new one, which shares all that
// stayed: bricks, and nodes of 8³ bricks. So a change costs what it touches, any
// number of readers keep what they read, and "what changed since revision n" is
// answered without a history: from the revisions that the bricks carry.
//
// The bricks are our own rather than OpenVDB's leaves: a leaf's buffer may be
// loaded or swapped behind the reader's back, and costs 5 % more memory.
// snapshot_builder.h converts both ways.
//
// Frame: I, voxel indices; brick (a, b, c) holds voxels 8a .. 8a + 7 along x and so
// on, voxel (i, j, k) of a brick at 64 i + 8 j + k. Voxels beyond the lattice are
// the background. Values in data units.
// Threads: any, at once. Real-time: Find and RevisionOf are wait-free and do not
// allocate; the rest is not for real-time code. Ownership: shared.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "common/bricks/brick.h"
#include "common/geometry/geometry.h"

namespace palpate {

struct BrickChange {
  Vec3i brick;  // its coordinates
  BrickPtr values;
};

class BrickDirectory {
 public:
  // values(brick) for every brick, none null, in the order of their numbers; all
  // of them changed at revision 1.
  BrickDirectory(const Vec3i& size_voxels,
                 const std::function<BrickPtr(const Vec3i& brick)>& values);

  // This directory with other bricks, which changed at `revision`; none twice.
  BrickDirectory With(std::span<const BrickChange> changes, std::uint64_t revision) const;

  // The same bricks, all of which changed at `revision`.
  BrickDirectory AllChangedAt(std::uint64_t revision) const;

  // What makes `this` to `other`, which has as many voxels: bricks that are
  // another object with other values. Nodes that both share cost nothing.
  std::vector<BrickChange> ChangesTo(const BrickDirectory& other) const;

  const Vec3i& brick_count() const { return brick_count_; }
  std::uint64_t NumberOf(const Vec3i& brick) const { return BrickNumber(brick, brick_count_); }
  Vec3i BrickOf(std::uint64_t number) const { return BrickWithNumber(number, brick_count_); }

  // Values of the brick that holds voxel (i, j, k), which is within the lattice.
  const float* Find(int i, int j, int k) const noexcept {
    const std::size_t node =
        (static_cast<std::size_t>(i >> 6) * node_count_.y() + (j >> 6)) * node_count_.z() +
        (k >> 6);
    return nodes_[node]->bricks[VoxelInBrick(i >> 3, j >> 3, k >> 3)]->data();
  }
  const BrickPtr& At(const Vec3i& brick) const;
  std::uint64_t RevisionOf(const Vec3i& brick) const noexcept {
    return nodes_[NodeOf(brick)]->revisions[PlaceInNode(brick)];
  }

  // Numbers of the bricks that changed after `revision`, ascending.
  std::vector<std::uint64_t> ChangedSince(std::uint64_t revision) const;

  const ContentHash& content_hash() const { return hash_; }
  // Of the bricks, shared ones counted once, and of the directory. Reads all of
  // it.
  std::uint64_t MemoryBytes() const;
  // The same of a directory that shares no brick.
  static std::uint64_t MemoryBytes(const Vec3i& size_voxels);

 private:
  // 8³ bricks, in the order of voxels in a brick.
  struct Node {
    std::array<BrickPtr, kBrickVoxels> bricks;
    std::array<std::uint64_t, kBrickVoxels> revisions{};
    std::uint64_t newest = 0;
  };

  std::size_t NodeOf(const Vec3i& brick) const {
    return (static_cast<std::size_t>(brick.x() >> 3) * node_count_.y() + (brick.y() >> 3)) *
               node_count_.z() +
           (brick.z() >> 3);
  }
  static std::size_t PlaceInNode(const Vec3i& brick) {
    return VoxelInBrick(brick.x(), brick.y(), brick.z());
  }

  // All bricks of the nodes that are wanted, node by node.
  void ForEachBrickOfNodes(
      const std::function<bool(std::size_t node)>& wanted,
      const std::function<void(std::size_t node, int place, const Vec3i& brick)>& visit) const;

  Vec3i brick_count_;
  Vec3i node_count_;
  std::vector<std::shared_ptr<const Node>> nodes_;
  ContentHash hash_;
};

}  // namespace palpate
