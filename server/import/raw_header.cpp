#include "server/import/raw_header.h"

#include "server/import/data_check.h"

namespace palpate {

ImageHeader CheckedRawHeader(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits) {
  CheckReadable(path);
  ImageHeader header;
  header.type = ParseScalarType(raw.type);
  header.size = VolumeSize({raw.size.begin(), raw.size.end()});
  header.big_endian = raw.big_endian;
  header.skip_bytes = raw.offset_bytes;
  if (raw.offset_bytes < 0) Refuse("the offset of raw voxels is negative; correct it");
  const std::int64_t voxel_bytes =
      CheckedVoxelBytes(header.size, header.type, ReadType(header), limits);
  std::int64_t needed = 0;
  const auto present = static_cast<std::int64_t>(std::filesystem::file_size(path));
  if (__builtin_add_overflow(raw.offset_bytes, voxel_bytes, &needed) || needed != present) {
    Refuse("the file has " + std::to_string(present) + " bytes where an offset of " +
           std::to_string(raw.offset_bytes) + " and " + std::to_string(voxel_bytes) +
           " bytes of voxels are stated; correct size, type or offset");
  }
  return header;
}

}  // namespace palpate
