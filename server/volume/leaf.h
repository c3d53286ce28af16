// A brick of a volume: a leaf node of OpenVDB, 8³ voxels of the file's own type, that never
// changes.
//
// A leaf is taken out of a grid without a copy, shared by all that hold it, and freed by the last
// of them. Whoever wants other voxels makes another leaf.
//
// Values in data units; voxel (i, j, k) of a leaf at 64 i + 8 j + k, as in a brick
// (bricks/brick.h). Threads: any, at once. Real-time: reading is wait-free and allocates nothing;
// the rest is not for real-time code. Ownership: counted in the leaf itself (LeafPtr).
#pragma once

#include <boost/smart_ptr/intrusive_ptr.hpp>
#include <boost/smart_ptr/intrusive_ref_counter.hpp>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "common/bricks/brick.h"
#include "server/volume/leaf_type.h"
#include "server/volume/openvdb_names.h"

namespace palpate {

class Leaf;
using LeafPtr = boost::intrusive_ptr<const Leaf>;

class Leaf : public boost::intrusive_ref_counter<Leaf, boost::thread_safe_counter> {
 public:
  template <class T>
  using Node = openvdb::tree::LeafNode<T, 3>;

  // Defined for the four types. The node's buffer is in memory.
  template <class T>
  static LeafPtr Take(std::unique_ptr<Node<T>> node);

  // The type holds the values exactly. Every voxel is active.
  static LeafPtr Of(LeafType type, const Brick& values);
  // 8³ times the value. Made once for many places: is_constant().
  static LeafPtr Constant(LeafType type, float value, bool is_active = true);
  // In the smallest type that holds them all.
  static LeafPtr Smallest(const Brick& values);

  // Other voxels: in the same type if it holds them exactly, else in float. What differs becomes
  // active, the rest stays as it is.
  LeafPtr With(const Brick& values) const;

  ~Leaf();
  Leaf(const Leaf&) = delete;
  Leaf& operator=(const Leaf&) = delete;

  LeafType type() const noexcept { return type_; }
  // T: that of type().
  template <class T>
  const T* values() const noexcept {
    return static_cast<const T*>(values_);
  }
  // Every type of a voxel is a float exactly.
  float operator[](std::size_t n) const noexcept {
    return VisitType(type_,
                     [&](auto voxel) { return static_cast<float>(values<decltype(voxel)>()[n]); });
  }
  // To kBrickVoxels floats.
  void CopyTo(float* out) const noexcept;
  Brick Floats() const noexcept;

  bool IsActive(std::size_t n) const noexcept;

  // Made by Constant(): it stands at many places, and a place of it costs nothing.
  bool is_constant() const noexcept { return is_constant_; }

  // Of the heap.
  std::uint64_t Bytes() const noexcept { return Bytes(type_); }
  static std::uint64_t Bytes(LeafType type) noexcept;

 private:
  Leaf(LeafType type, void* node, const void* values) noexcept;

  const void* values_;
  void* node_;  // Node<T>, owned
  LeafType type_;
  bool is_constant_ = false;
};

// As floats: 0 equals -0.
bool HaveSameValues(const Leaf& one, const Leaf& other) noexcept;
// As floats, bit by bit: 0 is not -0.
bool HaveSameBits(const Leaf& one, const Leaf& other) noexcept;

// Whether every value is one of the type's.
bool Holds(LeafType type, const Brick& values) noexcept;

}  // namespace palpate
