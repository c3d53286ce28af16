// The types of a leaf's voxels: the types of most scanners, and float for all others.
//
// Threads: pure, any. Real-time: yes.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>
#include <type_traits>

namespace palpate {

// The numbers must not change: they are part of the hand-over (handover.h).
enum class LeafType : std::uint8_t { kUint8 = 0, kInt16 = 1, kUint16 = 2, kFloat = 3 };

inline constexpr LeafType kLeafTypes[] = {LeafType::kUint8, LeafType::kInt16, LeafType::kUint16,
                                          LeafType::kFloat};

// Calls visit(T()), where T is the type's C++ type.
template <class Visit>
constexpr decltype(auto) VisitType(LeafType type, Visit&& visit) {
  switch (type) {
    case LeafType::kUint8:
      return visit(std::uint8_t());
    case LeafType::kInt16:
      return visit(std::int16_t());
    case LeafType::kUint16:
      return visit(std::uint16_t());
    case LeafType::kFloat:
      break;
  }
  return visit(float());
}

template <class T>
inline constexpr LeafType kLeafTypeOf = std::is_same_v<T, std::uint8_t>    ? LeafType::kUint8
                                        : std::is_same_v<T, std::int16_t>  ? LeafType::kInt16
                                        : std::is_same_v<T, std::uint16_t> ? LeafType::kUint16
                                                                           : LeafType::kFloat;

constexpr std::size_t VoxelBytes(LeafType type) {
  return VisitType(type, [](auto voxel) { return sizeof(voxel); });
}

// True if the type holds the value, bit by bit: no integer type holds -0.
constexpr bool Holds(LeafType type, float value) {
  return VisitType(type, [value](auto voxel) {
    using T = decltype(voxel);
    if constexpr (std::is_same_v<T, float>) {
      return true;
    } else {
      using Limits = std::numeric_limits<T>;
      // Also false for NaN.
      if (!(value >= static_cast<float>(Limits::min()) &&
            value <= static_cast<float>(Limits::max()))) {
        return false;
      }
      const auto stored = static_cast<float>(static_cast<T>(value));
      return std::bit_cast<std::uint32_t>(stored) == std::bit_cast<std::uint32_t>(value);
    }
  });
}

// The smallest type that holds all values of both.
constexpr LeafType CommonType(LeafType one, LeafType other) {
  if (one == other || other == LeafType::kUint8) return one;
  return one == LeafType::kUint8 ? other : LeafType::kFloat;
}

// "uint8", "int16", "uint16" or "float32".
constexpr std::string_view Name(LeafType type) {
  constexpr std::string_view kNames[] = {"uint8", "int16", "uint16", "float32"};
  return kNames[static_cast<int>(type)];
}

// The type with this name; none for other names.
constexpr std::optional<LeafType> LeafTypeNamed(std::string_view name) {
  for (const LeafType type : kLeafTypes) {
    if (Name(type) == name) return type;
  }
  return std::nullopt;
}

}  // namespace palpate
