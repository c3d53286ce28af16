// Bricks of 8³ voxels: the daemon stores and transfers volumes as bricks.
//
// Frame: I, voxel indices. Brick (a, b, c) holds the voxels 8a to 8a + 7 along x, and likewise
// along y and z. Voxel (i, j, k) of a brick is at 64 i + 8 j + k. With nb and nc bricks along y and
// z, the brick's number is (a nb + b) nc + c. Voxels beyond the lattice are the background. Values
// in data units.
// Threads: pure.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr int kBrickEdge = 8;
inline constexpr int kBrickVoxels = kBrickEdge * kBrickEdge * kBrickEdge;

using Brick = std::array<float, kBrickVoxels>;

// Returns the number of bricks along an axis of `size` voxels.
constexpr int BrickCount(int size) { return (size + kBrickEdge - 1) / kBrickEdge; }

constexpr std::size_t VoxelInBrick(int i, int j, int k) {
  return static_cast<std::size_t>((i & 7) << 6 | (j & 7) << 3 | (k & 7));
}

// The number of a brick among `count` bricks, and the reverse.
std::uint64_t BrickNumber(const Vec3i& brick, const Vec3i& count);
Vec3i BrickWithNumber(std::uint64_t number, const Vec3i& count);

// Identifies the voxels of a volume. Both halves of the XXH3-128 of every brick, seeded with the
// brick's number, are summed over the bricks modulo 2^64. Updating the hash takes time only for
// changed bricks. It does not protect against forgery.
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
// The XXH3-128 of the byte `kind` and then of the bytes.
ContentHash HashOfBytes(std::byte kind, std::span<const std::byte> bytes);

}  // namespace palpate
