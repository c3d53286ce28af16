// Bytes that browsers fetch under a name that is a hash of them, so that they never change: groups
// of voxels, overviews, manifests.
//
// Threads: any, at once. Errors: kInternal (bytes that cannot be compressed), and as stated.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

#include "common/bricks/brick.h"

namespace palpate::web {

// Names of blobs: a content hash as 32 hex digits, the high half first.
//
// Threads: pure. Errors: as stated.

std::string NameOf(const ContentHash& hash);
// None if it is no name: other than 32 digits, capital letters.
std::optional<ContentHash> ParseName(std::string_view name);
// Its 16 bytes in the order of the name's digits.
std::array<char, 16> BytesOf(const ContentHash& hash);
// Of exactly these 16 bytes.
ContentHash HashOf(std::string_view bytes);
std::string Base64(std::string_view bytes);
// Errors: kInvalidArgument (no base64 with its padding).
std::string FromBase64(std::string_view text);

enum class Encoding { kIdentity, kZstd, kGzip };

class Blob {
 public:
  // `bytes` makes the plain bytes, the same ones at every call, on any thread.
  // `content_type`: a literal.
  Blob(std::string name, std::string_view content_type, std::function<std::string()> bytes);
  // Of bytes that are already compressed, which it keeps. Encoded() throws kInvalidArgument if they
  // are not, or hold more than kMostBytes.
  Blob(std::string name, std::string_view content_type, std::shared_ptr<const std::string> zstd);
  ~Blob();
  Blob(const Blob&) = delete;
  Blob& operator=(const Blob&) = delete;

  const std::string& name() const { return name_; }  // 32 hex digits
  // "application/octet-stream" or "application/json".
  std::string_view content_type() const { return content_type_; }
  // Compresses when first asked for and keeps the result, as long as all blobs of the program keep
  // at most kMaxKeptBytes. Never null.
  std::shared_ptr<const std::string> Encoded(Encoding encoding) const;

  static constexpr std::size_t kMostBytes = std::size_t{64} << 20;
  static constexpr std::size_t kMaxKeptBytes = std::size_t{512} << 20;
  static std::size_t kept_bytes();  // compressed ones, of all blobs

 private:
  const std::string name_;
  const std::string_view content_type_;
  const std::function<std::string()> bytes_;
  mutable std::mutex mutex_;
  mutable std::shared_ptr<const std::string> zstd_, gzip_;  // null: not kept
};
using BlobPtr = std::shared_ptr<const Blob>;

// The blobs that browsers can fetch: those in use, and for a while those that were superseded, so
// that a page that is fetching them finishes.
//
// Equal blobs are one. Threads: Find on any; all else on one. Time is passed in.
class BlobShelf {
 public:
  using Time = std::chrono::steady_clock::time_point;

  static constexpr std::chrono::seconds kKeptFor{10};
  static constexpr std::size_t kMostSupersededBytes = std::size_t{256} << 20;

  // Null: not kept.
  BlobPtr Find(std::string_view name) const;

  // The blob is in use once more. `make` is called if it is not there. `bytes`: what it is taken to
  // hold in memory.
  void Use(const ContentHash& hash, std::size_t bytes, const std::function<BlobPtr()>& make);
  // The blob is in use once less.
  void Release(const ContentHash& hash, Time now);
  // Drops the blob at once if it is superseded.
  void Drop(const ContentHash& hash);
  // Drops what was superseded long ago, and the oldest while all that is superseded is too large.
  void Expire(Time now);

  // In use or superseded.
  std::size_t size() const;
  std::size_t superseded_bytes() const { return superseded_bytes_; }

 private:
  struct Held {
    BlobPtr blob;
    std::size_t bytes = 0;
    std::uint32_t uses = 0;
    std::uint64_t superseded = 0;  // the number of its last Release
  };
  struct Superseded {
    ContentHash hash;
    std::uint64_t number = 0;
    Time since;
  };
  struct Hash {
    std::size_t operator()(const ContentHash& hash) const { return hash.low; }
  };

  mutable std::mutex mutex_;
  std::unordered_map<ContentHash, Held, Hash> held_;
  std::deque<Superseded> superseded_;  // oldest first; some may be in use again
  std::size_t superseded_bytes_ = 0;
  std::uint64_t releases_ = 0;
};

}  // namespace palpate::web
