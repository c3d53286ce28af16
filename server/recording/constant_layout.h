// Writes a message of protobuf in which each number has a constant width.
//
// Threads: one per object. Does not allocate. Errors: none; a message has at most kMostBytes.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <type_traits>

#include "common/geometry/geometry.h"

namespace palpate {

class ConstantLayout {
 public:
  static constexpr std::size_t kMostBytes = 2048;  // a length then takes two bytes

  // A number that needs more than `width` bytes takes more.
  template <std::integral Number>
  void Varint(int field, Number number, int width) {
    Tag(field, 0);
    auto rest = static_cast<std::uint64_t>(number);
    for (; width > 1 || rest > 0x7f; --width, rest >>= 7) Byte(rest | 0x80);
    Byte(rest);
  }
  template <class Enum>
  requires std::is_enum_v<Enum>
  void Varint(int field, Enum enumerator, int width) {
    Varint(field, static_cast<std::uint32_t>(enumerator), width);
  }
  void Double(int field, double number) {
    Tag(field, 1);
    std::memcpy(&bytes_[size_], &number, sizeof number);
    size_ += sizeof number;
  }
  // Calls `put` for what is within.
  template <class Put>
  void Message(int field, Put&& put) {
    Tag(field, 2);
    const std::size_t begin = ++size_;
    put();
    const std::size_t within = size_ - begin;
    if (within > 0x7f) std::memmove(&bytes_[begin + 1], &bytes_[begin], within);
    size_ = begin - 1;
    Short(within);
    size_ += within;
  }
  std::string_view bytes() const { return {bytes_.data(), size_}; }

 private:
  void Tag(int field, std::size_t kind) { Short(static_cast<std::size_t>(field) << 3 | kind); }
  // A varint of at most two bytes.
  void Short(std::size_t number) {
    if (number > 0x7f) Byte(number | 0x80);
    Byte(number > 0x7f ? number >> 7 : number);
  }
  void Byte(std::uint64_t byte) { bytes_[size_++] = static_cast<char>(byte); }

  std::array<char, kMostBytes> bytes_;
  std::size_t size_ = 0;
};

inline void Put(const Vec3& v, ConstantLayout& layout) {
  for (int n = 0; n < 3; ++n) layout.Double(n + 1, v[n]);
}
inline void Put(const UnalignedQuaternion& q, ConstantLayout& layout) {
  int field = 0;
  for (const double number : {q.w(), q.x(), q.y(), q.z()}) layout.Double(++field, number);
}

}  // namespace palpate
