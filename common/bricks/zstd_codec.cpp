#include "common/bricks/zstd_codec.h"

#include <zstd.h>

#include <bit>
#include <memory>

#include "common/error/error.h"

namespace palpate {
namespace {

static_assert(std::endian::native == std::endian::little && sizeof(float) == 4,
              "values travel as they lie in memory");

constexpr int kLevel = 1;

struct Free {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

}  // namespace

std::string CompressBytes(std::span<const std::byte> values) {
  // One context per thread: making one costs more than compressing a few bricks.
  thread_local const std::unique_ptr<ZSTD_CCtx, Free> context(ZSTD_createCCtx());
  std::string zstd(MostCompressedBytes(values.size()), '\0');
  const std::size_t size = ZSTD_compressCCtx(context.get(), zstd.data(), zstd.size(), values.data(),
                                             values.size(), kLevel);
  if (ZSTD_isError(size)) {
    throw Error(ErrorKind::kInternal,
                std::string("voxels cannot be compressed: ") + ZSTD_getErrorName(size));
  }
  zstd.resize(size);
  return zstd;
}

std::size_t MostCompressedBytes(std::size_t bytes) { return ZSTD_compressBound(bytes); }

std::size_t CountValues(std::string_view zstd, std::size_t value_bytes, std::size_t most) {
  const unsigned long long size = ZSTD_getFrameContentSize(zstd.data(), zstd.size());
  if (size == ZSTD_CONTENTSIZE_UNKNOWN || size == ZSTD_CONTENTSIZE_ERROR ||
      size % value_bytes != 0 || size / value_bytes > most) {
    throw Error(ErrorKind::kInvalidArgument,
                "voxels arrived damaged: their zstd bytes do not hold at most " +
                    std::to_string(most) + " values");
  }
  return size / value_bytes;
}

void DecompressBytes(std::string_view zstd, std::span<std::byte> values) {
  thread_local const std::unique_ptr<ZSTD_DCtx, Free> context(ZSTD_createDCtx());
  const std::size_t size =
      ZSTD_decompressDCtx(context.get(), values.data(), values.size(), zstd.data(), zstd.size());
  if (ZSTD_isError(size) || size != values.size()) {
    throw Error(ErrorKind::kInvalidArgument,
                "voxels arrived damaged: their zstd bytes do not hold " +
                    std::to_string(values.size()) + " bytes of voxels");
  }
}

}  // namespace palpate
