// Turns the fuzzer's bytes into values, and reports failures of a fuzz target.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>

#include "common/geometry/geometry.h"

// Ends the program if the condition is false: the fuzzer looks for such ends.
#define FUZZ_CHECK(condition)                                                        \
  do {                                                                               \
    if (!(condition)) {                                                              \
      std::fprintf(stderr, "%s:%d: not true: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                  \
    }                                                                                \
  } while (false)

// Begins the function that takes an input (data, size) and returns 0. libFuzzer wants one name for
// all; in fuzz_replay each target has its own.
#ifdef PALPATE_FUZZ_ALONE
#define FUZZ_TARGET(name) \
  extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
#else
#define FUZZ_TARGET(name) extern "C" int name(const std::uint8_t* data, std::size_t size)
#endif

namespace palpate::fuzz {

// Reads from the front. After the end, all values are 0.
class Input {
 public:
  explicit Input(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  bool empty() const { return bytes_.empty(); }

  template <typename T>
  T Take() {
    T value{};
    const auto bytes = TakeBytes(sizeof(T));
    if (!bytes.empty()) std::memcpy(&value, bytes.data(), bytes.size());
    return value;
  }

  std::span<const std::uint8_t> TakeBytes(std::size_t size) {
    const auto bytes = bytes_.first(std::min(size, bytes_.size()));
    bytes_ = bytes_.subspan(bytes.size());
    return bytes;
  }

  std::span<const std::uint8_t> TakeRest() { return TakeBytes(bytes_.size()); }

  // Takes any bits, including infinities and NaN.
  Vec3 TakeVec3() {
    Vec3 v;
    for (int axis = 0; axis < 3; ++axis) v[axis] = Take<double>();
    return v;
  }

 private:
  std::span<const std::uint8_t> bytes_;
};

}  // namespace palpate::fuzz
