// Computes the content hash that a volume would have if all its voxels were background.
//
// A client starts from this hash, so it hashes only the bricks that came. A lattice of 2048³ voxels
// takes about 1.5 s, so the work is done in pieces, once per volume.
//
// Threads: one at a time.
#pragma once

#include <algorithm>
#include <cstdint>

#include "common/bricks/brick.h"

namespace palpate {

class BackgroundHash {
 public:
  BackgroundHash(std::uint64_t bricks, float background) : bricks_(bricks) {
    background_.fill(background);
  }

  // Hashes at most `most` more bricks. Returns true if the hash is complete.
  bool Advance(std::uint64_t most) {
    const std::uint64_t end = std::min(bricks_, next_ + most);
    for (; next_ < end; ++next_) hash_ += HashOfBrick(background_, next_);
    return next_ == bricks_;
  }
  const ContentHash& hash() const { return hash_; }

 private:
  const std::uint64_t bricks_;
  Brick background_;
  std::uint64_t next_ = 0;
  ContentHash hash_;
};

}  // namespace palpate
