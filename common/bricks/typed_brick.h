// A brick of 8³ voxels in a volume's own type (leaf_type.h), as clients hold it. Immutable, shared.
//
// A brick with one value throughout takes the memory of one voxel. Values in data units. Voxel
// (i, j, k) is at 64 i + 8 j + k, as in brick.h. Threads: any, at once.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>

#include "common/bricks/brick.h"
#include "common/bricks/leaf_type.h"

namespace palpate {

class TypedBrick;
using TypedBrickPtr = std::shared_ptr<const TypedBrick>;

class TypedBrick {
 public:
  // Copies 8³ voxels of the type. Defined for the four types.
  template <class T>
  static TypedBrickPtr Of(std::span<const T, kBrickVoxels> values);
  // `type` must hold the value exactly.
  static TypedBrickPtr Constant(LeafType type, float value);

  TypedBrick(const TypedBrick&) = delete;
  TypedBrick& operator=(const TypedBrick&) = delete;

  LeafType type() const { return type_; }
  // One value throughout, by Constant().
  bool is_constant() const { return mask_ == 0; }
  // T must be the type of type(). A constant brick has one voxel, all others have 8³.
  template <class T>
  const T* values() const {
    return static_cast<const T*>(values_);
  }
  // A float holds every voxel type's values exactly.
  float operator[](std::size_t n) const {
    return VisitType(type_, [&](auto voxel) {
      return static_cast<float>(values<decltype(voxel)>()[n & mask_]);
    });
  }
  void CopyTo(std::span<float, kBrickVoxels> out) const;
  Brick Floats() const;

 protected:
  TypedBrick(LeafType type, bool is_constant)
      : mask_(is_constant ? 0 : kBrickVoxels - 1), type_(type) {}
  ~TypedBrick() = default;
  // Of the derived class that stores them.
  const void* values_ = nullptr;

 private:
  std::uint16_t mask_;  // of a voxel's place
  LeafType type_;
};

}  // namespace palpate
