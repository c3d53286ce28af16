// A bounded queue from one thread to one other thread.
//
// Threads: TryPush on the one producer, TryPop on the one consumer; overflows() on any thread.
// Real-time: TryPush and TryPop are wait-free, without allocation or system calls. The constructor
// writes all slots, so that their memory is mapped before the first tick.
// Errors: a full ring drops the new item and counts it. The producer never waits for the consumer.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace palpate {

template <class T, std::size_t kCapacity>
class SpscRing {
  static_assert(std::is_trivially_copyable_v<T>);
  static_assert(kCapacity > 0 && (kCapacity & (kCapacity - 1)) == 0, "must be a power of two");
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

 public:
  SpscRing() = default;
  SpscRing(const SpscRing&) = delete;
  SpscRing& operator=(const SpscRing&) = delete;

  // Producer. False: the ring is full; the item is dropped and counted.
  bool TryPush(const T& item) noexcept {
    const std::uint64_t write = write_.load(std::memory_order_relaxed);
    if (write - read_.load(std::memory_order_acquire) == kCapacity) {
      // Only the producer writes the counter, so no read-modify-write is needed.
      overflows_.store(overflows_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      return false;
    }
    slots_[write & kMask] = item;
    write_.store(write + 1, std::memory_order_release);
    return true;
  }

  // Consumer. False: the ring is empty and `item` is untouched.
  bool TryPop(T& item) noexcept {
    const std::uint64_t read = read_.load(std::memory_order_relaxed);
    if (read == write_.load(std::memory_order_acquire)) return false;
    item = slots_[read & kMask];
    read_.store(read + 1, std::memory_order_release);
    return true;
  }

  // Items dropped since construction.
  std::uint64_t overflows() const noexcept { return overflows_.load(std::memory_order_relaxed); }

 private:
  // Not std::hardware_destructive_interference_size: gcc warns that it varies
  // with the tuning flags.
  static constexpr std::size_t kCacheLineBytes = 64;
  static constexpr std::uint64_t kMask = kCapacity - 1;

  // The indices only count up; 64 bits do not wrap. Each side writes to its own cache lines.
  alignas(kCacheLineBytes) std::atomic<std::uint64_t> write_{0};
  std::atomic<std::uint64_t> overflows_{0};
  alignas(kCacheLineBytes) std::atomic<std::uint64_t> read_{0};
  alignas(kCacheLineBytes) std::array<T, kCapacity> slots_{};
};

}  // namespace palpate
