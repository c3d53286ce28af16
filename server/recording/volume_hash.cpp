#include "server/recording/volume_hash.h"

#include <xxhash.h>

#include <memory>
#include <new>
#include <vector>

#include "server/recording/bytes.h"

namespace palpate {

VolumeHash HashVolume(const VolumeSnapshot& volume) {
  const std::unique_ptr<XXH3_state_t, decltype(&XXH3_freeState)> state(XXH3_createState(),
                                                                       XXH3_freeState);
  if (!state || XXH3_128bits_reset(state.get()) != XXH_OK) throw std::bad_alloc();
  const VolumeMetadata& metadata = volume.metadata();
  ByteWriter head;
  for (int axis = 0; axis < 3; ++axis) head.Put(metadata.size[axis]);
  for (int axis = 0; axis < 3; ++axis) head.Put(metadata.spacing_mm[axis]);
  head.Put(metadata.value_min);
  head.Put(metadata.value_max);
  XXH3_128bits_update(state.get(), head.bytes().data(), head.bytes().size());

  std::vector<double> row(static_cast<std::size_t>(metadata.size.z()));
  for (int i = 0; i < metadata.size.x(); ++i) {
    for (int j = 0; j < metadata.size.y(); ++j) {
      for (int k = 0; k < metadata.size.z(); ++k) row[k] = volume.StoredVertex({i, j, k});
      XXH3_128bits_update(state.get(), row.data(), row.size() * sizeof(double));
    }
  }
  const XXH128_hash_t hash = XXH3_128bits_digest(state.get());
  return {hash.high64, hash.low64};
}

}  // namespace palpate
