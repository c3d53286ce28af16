#include "client/web/volume/blob.h"

#include <zlib.h>

#include <atomic>
#include <span>
#include <utility>

#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

// Compressed bytes that blobs keep. A copy of a volume that does not compress must not double.
std::atomic<std::size_t> all_kept_bytes{0};

std::string Gzip(const std::string& bytes) {
  z_stream stream{};
  constexpr int kGzipWindow = 15 + 16;
  if (deflateInit2(&stream, 1, Z_DEFLATED, kGzipWindow, 8, Z_DEFAULT_STRATEGY) != Z_OK) {
    throw Error(ErrorKind::kInternal, "gzip cannot begin");
  }
  std::string gzip(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(gzip.data());
  stream.avail_out = static_cast<uInt>(gzip.size());
  const int result = deflate(&stream, Z_FINISH);
  gzip.resize(stream.total_out);
  deflateEnd(&stream);
  if (result != Z_STREAM_END) throw Error(ErrorKind::kInternal, "bytes cannot be compressed");
  return gzip;
}

std::string Plain(std::string_view zstd) {
  std::string bytes(CountValues(zstd, 1, Blob::kMostBytes), '\0');
  DecompressBytes(zstd, std::as_writable_bytes(std::span(bytes)));
  return bytes;
}

}  // namespace

Blob::Blob(std::string name, std::string_view content_type, std::function<std::string()> bytes)
    : name_(std::move(name)), content_type_(content_type), bytes_(std::move(bytes)) {}

Blob::Blob(std::string name, std::string_view content_type, std::shared_ptr<const std::string> zstd)
    : Blob(std::move(name), content_type, [zstd] { return Plain(*zstd); }) {
  all_kept_bytes += zstd->size();
  zstd_ = std::move(zstd);
}

Blob::~Blob() {
  for (const auto* kept : {&zstd_, &gzip_}) {
    if (*kept) all_kept_bytes -= (*kept)->size();
  }
}

std::size_t Blob::kept_bytes() { return all_kept_bytes; }

std::shared_ptr<const std::string> Blob::Encoded(Encoding encoding) const {
  if (encoding == Encoding::kIdentity) return std::make_shared<const std::string>(bytes_());
  const std::lock_guard lock(mutex_);
  std::shared_ptr<const std::string>& kept = encoding == Encoding::kZstd ? zstd_ : gzip_;
  if (kept) return kept;
  const std::string bytes = bytes_();
  auto made = std::make_shared<const std::string>(
      encoding == Encoding::kZstd ? CompressBytes(std::as_bytes(std::span(bytes))) : Gzip(bytes));
  if (all_kept_bytes + made->size() <= kMaxKeptBytes) {
    all_kept_bytes += made->size();
    kept = made;
  }
  return made;
}

}  // namespace palpate::web
