// Blobs as a room keeps them: zstd bytes in parts, each of which fits a NATS message.
//
//   at   type   what
//     0  u8     1: version
//     1  u8     LeafType of the voxels; 255: a manifest
//     2  u16    number of the part
//     4  u16    parts of the blob
//     6  16 B   hash of the kind and the plain bytes (BytesOf), which is the blob's name
//    22         a slice of the blob's zstd frame, at most kMostSlice
//
// Little-endian. A group has one part. A hash of zeros and no bytes: a group of background.
//
// Threads: pure. Errors: as stated.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/volume/blob.h"
#include "common/bricks/brick.h"

namespace palpate::web {

inline constexpr std::uint8_t kManifestKind = 255;
inline constexpr std::size_t kMostSlice = std::size_t{512} << 10;
// zstd bytes are a little longer than what they hold, if that is random.
inline constexpr std::uint16_t kMostParts = Blob::kMostBytes / kMostSlice + 1;

struct Part {
  std::uint8_t kind = 0;
  std::uint16_t number = 0;
  std::uint16_t count = 1;
  ContentHash hash{};
  std::string_view slice;  // borrowed
};

std::string EncodePart(const Part& part);
// None: no part, or of another version. Borrows the bytes.
std::optional<Part> DecodePart(std::string_view bytes);

// All parts of a blob of this kind, encoded. Errors: kTooLarge if there are more than kMostParts.
std::vector<std::string> PartsOf(std::uint8_t kind, const ContentHash& hash, std::string_view zstd);
// What stands for a group of background.
std::string BackgroundPart();

// The plain bytes. Errors: kInvalidArgument if `zstd` holds more than `most` bytes, if it is longer
// than they need, or if `hash` is not that of its bytes under this kind.
std::string VerifiedBytes(std::uint8_t kind, const ContentHash& hash, std::string_view zstd,
                          std::size_t most);

// Puts parts of the newest blob together.
class PartsAssembler {
 public:
  // Takes a part. Of another blob than the last one, or of another count: begins anew with it.
  // Returns the blob's zstd bytes if this was the last part that was missing, and begins anew.
  std::optional<std::string> Take(const Part& part);
  void Clear();

  // Of the blob that is begun; zeros: none.
  const ContentHash& hash() const { return hash_; }
  // Numbers of its parts that did not come yet.
  std::vector<std::uint16_t> Missing() const;

 private:
  ContentHash hash_{};
  std::uint8_t kind_ = 0;
  std::vector<std::string> slices_;  // empty: missing
  std::size_t missing_ = 0;
};

}  // namespace palpate::web
