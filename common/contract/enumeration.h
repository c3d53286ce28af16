// What is declared of each enumerator of the contract: its word, and what it says to people.
// enumerations.h is generated from proto/palpate/v1 and includes this file.
//
// An enumerator has the number of the contract; kUnknown (0) was not sent, or is of another
// version. Threads: plain values. Real-time: no allocation, but for InWords. Errors: none.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

struct Enumerator {
  std::string_view word;    // "stop-call": on command lines, in tables and JSON
  std::string_view says;    // in a line without a full stop; empty: nothing to say
  std::string_view advice;  // what to do, in the same form
};

// By number.
template <class Enum>
inline constexpr std::array<Enumerator, 0> kEnumerators = {};

template <class Enum>
concept Declared = !kEnumerators<Enum>.empty();

// kUnknown for a number of another version.
template <Declared Enum>
constexpr Enum EnumeratorOf(int number) {
  const auto count = static_cast<int>(kEnumerators<Enum>.size());
  return number >= 0 && number < count ? static_cast<Enum>(number) : Enum::kUnknown;
}

template <Declared Enum>
constexpr const Enumerator& Describe(Enum value) {
  return kEnumerators<Enum>[static_cast<std::size_t>(EnumeratorOf<Enum>(static_cast<int>(value)))];
}

template <Declared Enum>
constexpr std::string_view NameOf(Enum value) {
  return Describe(value).word;
}

// None if no enumerator but kUnknown has this word.
template <Declared Enum>
constexpr std::optional<Enum> Named(std::string_view word) {
  for (std::size_t n = 1; n < kEnumerators<Enum>.size(); ++n) {
    if (kEnumerators<Enum>[n].word == word) return static_cast<Enum>(n);
  }
  return std::nullopt;
}

// All words but that of kUnknown.
template <Declared Enum>
inline constexpr auto kWords = [] {
  std::array<std::string_view, kEnumerators<Enum>.size() - 1> words;
  for (std::size_t n = 0; n < words.size(); ++n) words[n] = kEnumerators<Enum>[n + 1].word;
  return words;
}();

// "the stylus rests in its holder: take it out"; empty: nothing to say.
template <Declared Enum>
std::string InWords(Enum value) {
  const Enumerator& told = Describe(value);
  return std::string(told.says) + (told.advice.empty() ? "" : ": " + std::string(told.advice));
}

}  // namespace palpate
