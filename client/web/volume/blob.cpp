#include "client/web/volume/blob.h"

#include <zlib.h>

#include <atomic>
#include <cstdint>
#include <span>
#include <utility>

#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";
constexpr std::string_view kBase64Digits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

constexpr std::uint8_t kNoDigit = 64;

constexpr std::array<std::uint8_t, 256> Base64Values() {
  std::array<std::uint8_t, 256> values{};
  for (std::uint8_t& value : values) value = kNoDigit;
  for (std::size_t n = 0; n < kBase64Digits.size(); ++n) {
    values.at(static_cast<std::uint8_t>(kBase64Digits[n])) = static_cast<std::uint8_t>(n);
  }
  return values;
}

}  // namespace

std::array<char, 16> BytesOf(const ContentHash& hash) {
  std::array<char, 16> bytes;
  for (std::size_t n = 0; n < 16; ++n) {
    const std::uint64_t half = n < 8 ? hash.high : hash.low;
    bytes.at(n) = static_cast<char>(half >> (56 - 8 * (n % 8)) & 0xff);
  }
  return bytes;
}

std::string NameOf(const ContentHash& hash) {
  std::string name;
  for (const char byte : BytesOf(hash)) {
    const auto value = static_cast<std::uint8_t>(byte);
    name += kHexDigits[value >> 4];
    name += kHexDigits[value & 15];
  }
  return name;
}

std::optional<ContentHash> ParseName(std::string_view name) {
  if (name.size() != 32) return std::nullopt;
  ContentHash hash;
  for (std::size_t n = 0; n < 32; ++n) {
    const std::size_t digit = kHexDigits.find(name[n]);
    if (digit == std::string_view::npos) return std::nullopt;
    std::uint64_t& half = n < 16 ? hash.high : hash.low;
    half = half << 4 | digit;
  }
  return hash;
}

ContentHash HashOf(std::string_view bytes) {
  ContentHash hash;
  for (std::size_t n = 0; n < 16; ++n) {
    std::uint64_t& half = n < 8 ? hash.high : hash.low;
    half = half << 8 | static_cast<std::uint8_t>(bytes.at(n));
  }
  return hash;
}

std::string Base64(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t n = 0; n < bytes.size(); n += 3) {
    std::uint32_t three = 0;
    for (std::size_t m = n; m < n + 3; ++m) {
      three = three << 8 | (m < bytes.size() ? static_cast<std::uint8_t>(bytes[m]) : 0);
    }
    for (std::size_t m = 0; m < 4; ++m) {
      text += n + m <= bytes.size() ? kBase64Digits[three >> (18 - 6 * m) & 63] : '=';
    }
  }
  return text;
}

std::string FromBase64(std::string_view text) {
  static constexpr auto kValues = Base64Values();
  if (text.size() % 4 != 0) Refuse("no base64");
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with('=') ? 1 : 0;
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  for (std::size_t n = 0; n < text.size(); n += 4) {
    std::uint32_t three = 0;
    for (std::size_t m = n; m < n + 4; ++m) {
      const bool is_padding = m >= text.size() - padding;
      const std::uint8_t value = is_padding ? 0 : kValues.at(static_cast<std::uint8_t>(text[m]));
      if (value == kNoDigit) Refuse("no base64");
      three = three << 6 | value;
    }
    for (int shift = 16; shift >= 0; shift -= 8) bytes += static_cast<char>(three >> shift & 255);
  }
  bytes.resize(bytes.size() - padding);
  return bytes;
}

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

BlobPtr BlobShelf::Find(std::string_view name) const {
  const auto hash = ParseName(name);
  if (!hash) return nullptr;
  const std::lock_guard lock(mutex_);
  const auto found = held_.find(*hash);
  return found == held_.end() ? nullptr : found->second.blob;
}

void BlobShelf::Use(const ContentHash& hash, std::size_t bytes,
                    const std::function<BlobPtr()>& make) {
  const std::lock_guard lock(mutex_);
  Held& held = held_[hash];
  if (!held.blob) {
    held = {.blob = make(), .bytes = bytes};
  } else if (held.uses == 0) {
    superseded_bytes_ -= held.bytes;
  }
  ++held.uses;
}

void BlobShelf::Release(const ContentHash& hash, Time now) {
  const std::lock_guard lock(mutex_);
  Held& held = held_.at(hash);
  if (--held.uses > 0) return;
  held.superseded = ++releases_;
  superseded_bytes_ += held.bytes;
  superseded_.push_back({hash, held.superseded, now});
}

void BlobShelf::Drop(const ContentHash& hash) {
  const std::lock_guard lock(mutex_);
  const auto found = held_.find(hash);
  if (found == held_.end() || found->second.uses > 0) return;
  superseded_bytes_ -= found->second.bytes;
  held_.erase(found);
}

void BlobShelf::Expire(Time now) {
  const std::lock_guard lock(mutex_);
  while (!superseded_.empty() && (superseded_.front().since + kKeptFor <= now ||
                                  superseded_bytes_ > kMostSupersededBytes)) {
    const auto found = held_.find(superseded_.front().hash);
    const bool is_last = found != held_.end() && found->second.uses == 0 &&
                         found->second.superseded == superseded_.front().number;
    superseded_.pop_front();
    if (!is_last) continue;
    superseded_bytes_ -= found->second.bytes;
    held_.erase(found);
  }
}

std::size_t BlobShelf::size() const {
  const std::lock_guard lock(mutex_);
  return held_.size();
}

}  // namespace palpate::web
