#include "client/web/room/part.h"

#include <algorithm>
#include <span>

#include "client/web/volume/blob_name.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/leaf_type.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

constexpr char kVersion = 1;
constexpr std::size_t kHeaderBytes = 22;

bool IsKind(std::uint8_t kind) {
  return kind == kManifestKind || kind <= static_cast<std::uint8_t>(LeafType::kFloat);
}

void AppendU16(std::string& bytes, std::uint16_t value) {
  bytes += static_cast<char>(value & 0xff);
  bytes += static_cast<char>(value >> 8);
}

std::uint16_t U16At(std::string_view bytes, std::size_t at) {
  const auto low = static_cast<std::uint8_t>(bytes[at]);
  const auto high = static_cast<std::uint8_t>(bytes[at + 1]);
  return static_cast<std::uint16_t>(low | high << 8);
}

}  // namespace

std::string EncodePart(const Part& part) {
  std::string bytes{kVersion, static_cast<char>(part.kind)};
  bytes.reserve(kHeaderBytes + part.slice.size());
  AppendU16(bytes, part.number);
  AppendU16(bytes, part.count);
  const auto hash = BytesOf(part.hash);
  bytes.append(hash.data(), hash.size());
  return bytes += part.slice;
}

std::optional<Part> DecodePart(std::string_view bytes) {
  if (bytes.size() < kHeaderBytes || bytes.size() > kHeaderBytes + kMostSlice) return std::nullopt;
  const Part part{.kind = static_cast<std::uint8_t>(bytes[1]),
                  .number = U16At(bytes, 2),
                  .count = U16At(bytes, 4),
                  .hash = HashOf(bytes.substr(6, 16)),
                  .slice = bytes.substr(kHeaderBytes)};
  // Without a hash there are no bytes, and the reverse.
  const bool is_part = bytes[0] == kVersion && IsKind(part.kind) && part.number < part.count &&
                       part.count <= kMostParts &&
                       (part.hash == ContentHash{}) == part.slice.empty();
  return is_part ? std::optional(part) : std::nullopt;
}

std::vector<std::string> PartsOf(std::uint8_t kind, const ContentHash& hash,
                                 std::string_view zstd) {
  const std::size_t count = (zstd.size() + kMostSlice - 1) / kMostSlice;
  if (count > kMostParts) throw Error(ErrorKind::kTooLarge, "the volume is too large for a room");
  std::vector<std::string> parts;
  for (std::size_t n = 0; n < count; ++n) {
    parts.push_back(EncodePart({.kind = kind,
                                .number = static_cast<std::uint16_t>(n),
                                .count = static_cast<std::uint16_t>(count),
                                .hash = hash,
                                .slice = zstd.substr(n * kMostSlice, kMostSlice)}));
  }
  return parts;
}

std::string BackgroundPart() { return EncodePart({}); }

std::string VerifiedBytes(std::uint8_t kind, const ContentHash& hash, std::string_view zstd,
                          std::size_t most) {
  std::string bytes(CountValues(zstd, 1, most), '\0');
  if (zstd.size() > MostCompressedBytes(bytes.size()))
    Refuse("zstd bytes that hold something else");
  DecompressBytes(zstd, std::as_writable_bytes(std::span(bytes)));
  const ContentHash found =
      kind == kManifestKind ? HashOfManifest(bytes) : HashOfVoxels(LeafType{kind}, bytes);
  if (found != hash) Refuse("bytes of another hash than their name");
  return bytes;
}

std::optional<std::string> PartsAssembler::Take(const Part& part) {
  if (part.hash != hash_ || part.kind != kind_ || part.count != slices_.size()) {
    hash_ = part.hash;
    kind_ = part.kind;
    slices_.assign(part.count, {});
    missing_ = part.count;
  }
  std::string& slice = slices_.at(part.number);
  if (slice.empty()) --missing_;
  slice = part.slice;
  if (missing_ > 0) return std::nullopt;
  std::string whole;
  for (const std::string& one : slices_) whole += one;
  Clear();
  return whole;
}

void PartsAssembler::Clear() { *this = {}; }

std::vector<std::uint16_t> PartsAssembler::Missing() const {
  std::vector<std::uint16_t> missing;
  for (std::size_t n = 0; n < slices_.size(); ++n) {
    if (slices_[n].empty()) missing.push_back(static_cast<std::uint16_t>(n));
  }
  return missing;
}

}  // namespace palpate::web
