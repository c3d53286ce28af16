// Hands the newest value from one thread to one other thread. Both threads may be real-time.
//
// There are three slots: the writer fills one, the reader holds one, and a single atomic exchanges
// the third between them. A value that is read was written completely. Older values are lost
// unread.
//
// Threads: Write on the one writer, Read on the one reader.
// Real-time: wait-free; T's copy must neither allocate nor throw.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace palpate {

template <class T>
class LatestValue {
  static_assert(std::is_nothrow_copy_assignable_v<T>);

 public:
  explicit LatestValue(const T& first = T()) { slots_.fill(first); }
  LatestValue(const LatestValue&) = delete;
  LatestValue& operator=(const LatestValue&) = delete;

  void Write(const T& value) noexcept {
    slots_[writing_] = value;
    writing_ = between_.exchange(writing_ | kNew, std::memory_order_acq_rel) & kIndex;
  }

  // Returns the newest value. It stays unchanged until the next Read. `is_new`: this value was not
  // read before.
  const T& Read(bool& is_new) noexcept {
    is_new = (between_.load(std::memory_order_relaxed) & kNew) != 0;
    if (is_new) reading_ = between_.exchange(reading_, std::memory_order_acq_rel) & kIndex;
    return slots_[reading_];
  }
  const T& Read() noexcept {
    bool is_new = false;
    return Read(is_new);
  }

 private:
  static constexpr std::uint32_t kIndex = 3;
  static constexpr std::uint32_t kNew = 4;

  std::array<T, 3> slots_;
  alignas(64) std::atomic<std::uint32_t> between_{1};
  alignas(64) std::uint32_t writing_ = 0;
  alignas(64) std::uint32_t reading_ = 2;
};

}  // namespace palpate
