// Bricks of 8³ voxels: how the daemon keeps a volume, and how it travels.
//
// Frame: I, voxel indices; brick (a, b, c) holds voxels 8a .. 8a + 7 along x and so
// on, voxel (i, j, k) of a brick at 64 i + 8 j + k. With nb and nc bricks along y
// and z, its number is (a nb + b) nc + c. Voxels beyond the lattice are the
// background. Values in data units.
// Threads: pure.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr int kBrickEdge = 8;
inline constexpr int kBrickVoxels = kBrickEdge * kBrickEdge * kBrickEdge;

using Brick = std::array<float, kBrickVoxels>;
using BrickPtr = std::shared_ptr<const Brick>;

// Bricks along an axis of `size` voxels.
constexpr int BrickCount(int size) { return (size + kBrickEdge - 1) / kBrickEdge; }

constexpr std::size_t VoxelInBrick(int i, int j, int k) {
  return static_cast<std::size_t>((i & 7) << 6 | (j & 7) << 3 | (k & 7));
}

// Number of a brick among `count` bricks, and back.
std::uint64_t BrickNumber(const Vec3i& brick, const Vec3i& count);
Vec3i BrickWithNumber(std::uint64_t number, const Vec3i& count);

// A name for the voxels of a volume: both halves of the XXH3-128 of every
// brick, seeded with its number, summed over the bricks modulo 2^64. It follows a
// change in the time that the changed bricks take. No proof against forgery.
struct ContentHash {
  std::uint64_t high = 0;
  std::uint64_t low = 0;
  friend bool operator==(const ContentHash&, const ContentHash&) = default;

  ContentHash& operator+=(const ContentHash& other) {
    high += other.high;
    low += other.low;
    return *this;
  }
  ContentHash& operator-=(const ContentHash& other) {
    high -= other.high;
    low -= other.low;
    return *this;
  }
};
ContentHash HashOfBrick(const Brick& brick, std::uint64_t number);

}  // namespace palpate
