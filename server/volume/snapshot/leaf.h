// A brick of a volume: an immutable leaf node of OpenVDB, 8³ voxels of the file's own type.
//
// A leaf is taken out of a grid without a copy. All its owners share it, and the last owner frees
// it. To change voxels, make another leaf.
//
// Values in data units. Voxel (i, j, k) of a leaf is at 64 i + 8 j + k, as in a brick
// (bricks/brick.h). Threads: any, at once. Real-time: reading is wait-free and does not allocate;
// the rest is not for real-time code. Ownership: counted in the leaf itself (LeafPtr).
#pragma once

#include <boost/smart_ptr/intrusive_ptr.hpp>
#include <boost/smart_ptr/intrusive_ref_counter.hpp>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "common/bricks/brick.h"
#include "common/bricks/leaf_type.h"
#include "server/volume/snapshot/openvdb_names.h"

namespace palpate {

class Leaf;
using LeafPtr = boost::intrusive_ptr<const Leaf>;

class Leaf : public boost::intrusive_ref_counter<Leaf, boost::thread_safe_counter> {
 public:
  template <class T>
  using Node = openvdb::tree::LeafNode<T, 3>;

  // Defined for the four types. The node's buffer must be in memory.
  template <class T>
  static LeafPtr Take(std::unique_ptr<Node<T>> node);

  // `type` must hold the values exactly. Every voxel becomes active.
  static LeafPtr Of(LeafType type, const Brick& values);
  // A leaf with one value for all 8³ voxels. Made once for many places: is_constant().
  static LeafPtr Constant(LeafType type, float value, bool is_active = true);
  // A leaf of the smallest type that holds all values.
  static LeafPtr Smallest(const Brick& values);

  // Returns a leaf with other voxels: of the same type if it holds them exactly, otherwise of
  // float. Changed voxels become active; all others keep their state.
  LeafPtr With(const Brick& values) const;

  ~Leaf();
  Leaf(const Leaf&) = delete;
  Leaf& operator=(const Leaf&) = delete;

  LeafType type() const noexcept { return type_; }
  // T must be the type of type().
  template <class T>
  const T* values() const noexcept {
    return static_cast<const T*>(values_);
  }
  // A float holds every voxel type's values exactly.
  float operator[](std::size_t n) const noexcept {
    return VisitType(type_,
                     [&](auto voxel) { return static_cast<float>(values<decltype(voxel)>()[n]); });
  }
  // Writes kBrickVoxels floats.
  void CopyTo(float* out) const noexcept;
  Brick Floats() const noexcept;

  bool IsActive(std::size_t n) const noexcept;

  // True if made by Constant(): many places share the leaf, so a place costs no memory.
  bool is_constant() const noexcept { return is_constant_; }

  // Bytes on the heap.
  std::uint64_t Bytes() const noexcept { return Bytes(type_); }
  static std::uint64_t Bytes(LeafType type) noexcept;

 private:
  Leaf(LeafType type, void* node, const void* values) noexcept;

  const void* values_;
  void* node_;  // Node<T>, owned
  LeafType type_;
  bool is_constant_ = false;
};

// Compares as floats: 0 equals -0.
bool HaveSameValues(const Leaf& one, const Leaf& other) noexcept;
// Compares as floats, bit by bit: 0 is not -0.
bool HaveSameBits(const Leaf& one, const Leaf& other) noexcept;

// True if the type holds every value exactly.
bool Holds(LeafType type, const Brick& values) noexcept;

}  // namespace palpate
