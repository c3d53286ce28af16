// Counts the memory that the process holds in bricks: leaves (leaf.h) and blocks of directories
// (brick_directory.h). Each object counts once, however many owners it has.
//
// So volumes, frames of series, steps to undo, and old states that streams and recordings still
// read need no counting of their own.
//
// Threads: any, at once. Real-time: reading is wait-free. Nothing is counted on the servo's thread,
// which never makes or frees bricks.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <utility>

namespace palpate {

class BrickWork;

namespace internal {
inline std::atomic<std::uint64_t> live_brick_bytes{0};
inline thread_local BrickWork* brick_work = nullptr;  // the innermost one of this thread
}  // namespace internal

inline std::uint64_t LiveBrickBytes() noexcept {
  return internal::live_brick_bytes.load(std::memory_order_relaxed);
}

// Called by the constructors and destructors of leaves and blocks.
void AddBrickBytes(std::uint64_t bytes) noexcept;
void SubtractBrickBytes(std::uint64_t bytes) noexcept;

// Counts the bricks that its own thread makes and frees during its lifetime. While a nested object
// lives, the outer one does not count.
class BrickWork {
 public:
  enum class Freed : std::uint8_t {
    kGone,     // freed bricks no longer count
    kStillIn,  // freed bricks count until LetGo: their memory is still resident
  };
  explicit BrickWork(Freed freed = Freed::kGone) noexcept
      : freed_(freed), outer_(std::exchange(internal::brick_work, this)) {}
  ~BrickWork() {
    LetGo();
    internal::brick_work = outer_;
  }
  BrickWork(const BrickWork&) = delete;
  BrickWork& operator=(const BrickWork&) = delete;

  // Bytes made and not freed: now, and at the highest point. 0 if more was freed than made.
  std::uint64_t made_bytes() const noexcept {
    return made_ > 0 ? static_cast<std::uint64_t>(made_) : 0;
  }
  std::uint64_t most_bytes() const noexcept { return static_cast<std::uint64_t>(most_); }
  // Bytes freed that still count.
  std::uint64_t kept_bytes() const noexcept { return kept_; }
  void LetGo() noexcept {
    internal::live_brick_bytes.fetch_sub(std::exchange(kept_, 0), std::memory_order_relaxed);
  }

 private:
  friend void AddBrickBytes(std::uint64_t) noexcept;
  friend void SubtractBrickBytes(std::uint64_t) noexcept;

  const Freed freed_;
  BrickWork* const outer_;
  std::int64_t made_ = 0;
  std::int64_t most_ = 0;
  std::uint64_t kept_ = 0;
};

inline void AddBrickBytes(std::uint64_t bytes) noexcept {
  internal::live_brick_bytes.fetch_add(bytes, std::memory_order_relaxed);
  BrickWork* const work = internal::brick_work;
  if (!work) return;
  work->made_ += static_cast<std::int64_t>(bytes);
  work->most_ = std::max(work->most_, work->made_);
}

inline void SubtractBrickBytes(std::uint64_t bytes) noexcept {
  BrickWork* const work = internal::brick_work;
  if (work) work->made_ -= static_cast<std::int64_t>(bytes);
  if (work && work->freed_ == BrickWork::Freed::kStillIn) {
    work->kept_ += bytes;
  } else {
    internal::live_brick_bytes.fetch_sub(bytes, std::memory_order_relaxed);
  }
}

}  // namespace palpate
