// The blobs that browsers can fetch: those in use, and for a while those that were superseded, so
// that a page that is fetching them finishes.
//
// Equal blobs are one. Threads: Find on any; all else on one. Time is passed in.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string_view>
#include <unordered_map>

#include "client/web/volume/blob.h"
#include "common/bricks/brick.h"

namespace palpate::web {

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
