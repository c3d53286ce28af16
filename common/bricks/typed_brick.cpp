#include "common/bricks/typed_brick.h"

#include <algorithm>

namespace palpate {
namespace {

template <class T, std::size_t kVoxels>
class Stored final : public TypedBrick {
 public:
  explicit Stored(std::span<const T, kVoxels> values) : TypedBrick(kLeafTypeOf<T>, kVoxels == 1) {
    std::copy(values.begin(), values.end(), stored_.begin());
    values_ = stored_.data();
  }

 private:
  std::array<T, kVoxels> stored_;
};

}  // namespace

template <class T>
TypedBrickPtr TypedBrick::Of(std::span<const T, kBrickVoxels> values) {
  return std::make_shared<Stored<T, kBrickVoxels>>(values);
}

template TypedBrickPtr TypedBrick::Of(std::span<const std::uint8_t, kBrickVoxels>);
template TypedBrickPtr TypedBrick::Of(std::span<const std::int16_t, kBrickVoxels>);
template TypedBrickPtr TypedBrick::Of(std::span<const std::uint16_t, kBrickVoxels>);
template TypedBrickPtr TypedBrick::Of(std::span<const float, kBrickVoxels>);

TypedBrickPtr TypedBrick::Constant(LeafType type, float value) {
  return VisitType(type, [value](auto voxel) -> TypedBrickPtr {
    const std::array<decltype(voxel), 1> values{static_cast<decltype(voxel)>(value)};
    return std::make_shared<Stored<decltype(voxel), 1>>(std::span(values));
  });
}

void TypedBrick::CopyTo(std::span<float, kBrickVoxels> out) const {
  VisitType(type_, [&](auto voxel) {
    using T = decltype(voxel);
    const T* const from = values<T>();
    if (is_constant()) {
      std::fill(out.begin(), out.end(), static_cast<float>(*from));
      return;
    }
    // __restrict, because bytes may be part of anything: the compiler would convert them one by
    // one.
    float* __restrict to = out.data();
    const T* __restrict source = from;
    for (int n = 0; n < kBrickVoxels; ++n) to[n] = static_cast<float>(source[n]);
  });
}

Brick TypedBrick::Floats() const {
  Brick floats;
  CopyTo(floats);
  return floats;
}

}  // namespace palpate
