// How much memory the process holds in bricks: leaves (leaf.h) and blocks of directories
// (brick_directory.h), each counted once, whoever holds it and however many do.
//
// So volumes, frames of series, steps to undo, and old states that streams and recordings still
// read need no bookkeeping of their own.
//
// Threads: any, at once. Real-time: reading is wait-free; nothing is counted on the servo's thread,
// which neither makes nor frees bricks.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <utility>

namespace palpate {

class BrickWork;

namespace internal {
inline std::atomic<std::uint64_t> live_brick_bytes{0};
inline thread_local BrickWork* brick_work = nullptr;  // the innermost of the thread
}  // namespace internal

inline std::uint64_t LiveBrickBytes() noexcept {
  return internal::live_brick_bytes.load(std::memory_order_relaxed);
}

// For the constructors and destructors of what is counted.
void AddBrickBytes(std::uint64_t bytes) noexcept;
void SubtractBrickBytes(std::uint64_t bytes) noexcept;

// What the thread that constructed it makes and frees of bricks while it lives. Nested ones hide
// the outer one.
class BrickWork {
 public:
  enum class Freed : std::uint8_t {
    kGone,     // counts no more
    kStillIn,  // counts until LetGo: the heap has it, and the system does not
  };
  explicit BrickWork(Freed freed = Freed::kGone) noexcept
      : freed_(freed), outer_(std::exchange(internal::brick_work, this)) {}
  ~BrickWork() {
    LetGo();
    internal::brick_work = outer_;
  }
  BrickWork(const BrickWork&) = delete;
  BrickWork& operator=(const BrickWork&) = delete;

  // Made and not freed; 0 where more was freed. Now, and at most so far.
  std::uint64_t made_bytes() const noexcept {
    return made_ > 0 ? static_cast<std::uint64_t>(made_) : 0;
  }
  std::uint64_t most_bytes() const noexcept { return static_cast<std::uint64_t>(most_); }
  // Freed, and counted still.
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
