#include "common/bricks/brick.h"

#include <xxhash.h>

#include <memory>

namespace palpate {

std::uint64_t BrickNumber(const Vec3i& brick, const Vec3i& count) {
  return (static_cast<std::uint64_t>(brick.x()) * count.y() + brick.y()) * count.z() + brick.z();
}

Vec3i BrickWithNumber(std::uint64_t number, const Vec3i& count) {
  const auto y = static_cast<std::uint64_t>(count.y());
  const auto z = static_cast<std::uint64_t>(count.z());
  return {static_cast<int>(number / (y * z)), static_cast<int>(number / z % y),
          static_cast<int>(number % z)};
}

ContentHash HashOfBrick(const Brick& brick, std::uint64_t number) {
  const XXH128_hash_t hash = XXH3_128bits_withSeed(brick.data(), sizeof(Brick), number);
  return {hash.high64, hash.low64};
}

ContentHash HashOfBytes(std::byte kind, std::span<const std::byte> bytes) {
  struct Free {
    void operator()(XXH3_state_t* state) const { XXH3_freeState(state); }
  };
  thread_local const std::unique_ptr<XXH3_state_t, Free> state(XXH3_createState());
  XXH3_128bits_reset(state.get());
  XXH3_128bits_update(state.get(), &kind, 1);
  XXH3_128bits_update(state.get(), bytes.data(), bytes.size());
  const XXH128_hash_t hash = XXH3_128bits_digest(state.get());
  return {hash.high64, hash.low64};
}

}  // namespace palpate
