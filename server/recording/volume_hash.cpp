#include "server/recording/volume_hash.h"

#include <xxhash.h>

#include "server/recording/bytes.h"

namespace palpate {

VolumeHash HashVolume(const VolumeSnapshot& volume) {
  const VolumeMetadata& metadata = volume.metadata();
  ByteWriter bytes;
  for (int axis = 0; axis < 3; ++axis) bytes.Put(metadata.size[axis]);
  for (int axis = 0; axis < 3; ++axis) bytes.Put(metadata.spacing_mm[axis]);
  bytes.Put(metadata.value_min);
  bytes.Put(metadata.value_max);
  // Added only for level sets, so that the hashes of other volumes stay as in older versions.
  if (metadata.is_level_set) bytes.Put(metadata.is_level_set);
  bytes.Put(volume.bricks().content_hash().high);
  bytes.Put(volume.bricks().content_hash().low);
  const XXH128_hash_t hash = XXH3_128bits(bytes.bytes().data(), bytes.bytes().size());
  return {hash.high64, hash.low64};
}

}  // namespace palpate
