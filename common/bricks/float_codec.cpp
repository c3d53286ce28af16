#include "common/bricks/float_codec.h"

#include <zstd.h>

#include <bit>
#include <memory>

#include "common/error/error.h"

namespace palpate {
namespace {

static_assert(std::endian::native == std::endian::little && sizeof(float) == 4,
              "floats travel as they lie in memory");

constexpr int kLevel = 1;

struct Free {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

}  // namespace

std::string CompressFloats(std::span<const float> values) {
  // One context per thread: making one costs more than compressing a few bricks.
  thread_local const std::unique_ptr<ZSTD_CCtx, Free> context(ZSTD_createCCtx());
  std::string bytes(ZSTD_compressBound(values.size_bytes()), '\0');
  const std::size_t size = ZSTD_compressCCtx(context.get(), bytes.data(), bytes.size(),
                                             values.data(), values.size_bytes(), kLevel);
  if (ZSTD_isError(size)) {
    throw Error(ErrorKind::kInternal,
                std::string("voxels cannot be compressed: ") + ZSTD_getErrorName(size));
  }
  bytes.resize(size);
  return bytes;
}

std::size_t CountFloats(std::string_view bytes, std::size_t most) {
  const unsigned long long size = ZSTD_getFrameContentSize(bytes.data(), bytes.size());
  if (size == ZSTD_CONTENTSIZE_UNKNOWN || size == ZSTD_CONTENTSIZE_ERROR ||
      size % sizeof(float) != 0 || size / sizeof(float) > most) {
    throw Error(ErrorKind::kInvalidArgument,
                "voxels arrived damaged: their zstd bytes do not hold at most " +
                    std::to_string(most) + " floats");
  }
  return size / sizeof(float);
}

void DecompressFloats(std::string_view bytes, std::span<float> values) {
  thread_local const std::unique_ptr<ZSTD_DCtx, Free> context(ZSTD_createDCtx());
  const std::size_t size = ZSTD_decompressDCtx(context.get(), values.data(), values.size_bytes(),
                                               bytes.data(), bytes.size());
  if (ZSTD_isError(size) || size != values.size_bytes()) {
    throw Error(ErrorKind::kInvalidArgument,
                "voxels arrived damaged: their zstd bytes do not hold " +
                    std::to_string(values.size()) + " floats");
  }
}

}  // namespace palpate
