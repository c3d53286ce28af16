#include "server/recording/sample_codec.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "server/recording/bytes.h"
#include "server/recording/sample_fields.h"

namespace palpate {
namespace {

struct FieldSizes {
  std::size_t fields = 0;
  std::size_t bytes = 0;
};
constexpr FieldSizes kSizes = [] {
  FieldSizes sizes;
  TickSample sample;
  VisitFields(sample, [&](std::string_view, auto& field) {
    ++sizes.fields;
    sizes.bytes += sizeof field;
  });
  return sizes;
}();

template <class Field>
std::uint64_t ToWord(const Field& field) {
  // Files number enumerators from 0.
  if constexpr (std::is_enum_v<Field>) return static_cast<std::uint64_t>(field) - 1;
  std::uint64_t word = 0;
  std::memcpy(&word, &field, sizeof field);
  return word;
}

template <class Field>
void FromWord(std::uint64_t word, Field& field) {
  if constexpr (std::is_enum_v<Field>) {
    if (word >= kWords<Field>.size()) throw DamagedBytes("damaged: a field is out of its range");
    field = static_cast<Field>(word + 1);
  } else if constexpr (std::is_same_v<Field, bool>) {
    if (word > 1) throw DamagedBytes("damaged: a field is out of its range");
    field = word != 0;
  } else {
    std::memcpy(&field, &word, sizeof field);
  }
}

// Calls visit(field, offset of its column, bytes of one number).
template <class Sample, class Visit>
void VisitColumns(Sample& sample, std::size_t count, Visit&& visit) {
  std::size_t offset = 0;
  VisitFields(sample, [&](std::string_view, auto& field) {
    visit(field, offset);
    offset += sizeof field * count;
  });
}

// Folds the difference into a number of `bytes` bytes whose low bit is the sign. A small
// difference, positive or negative, then has zeros in its high bytes.
std::uint64_t Fold(std::uint64_t difference, std::size_t bytes) {
  const int unused_bits = static_cast<int>(64 - 8 * bytes);
  const auto signed_difference =
      static_cast<std::int64_t>(difference << unused_bits) >> unused_bits;
  return (static_cast<std::uint64_t>(signed_difference) << 1) ^
         static_cast<std::uint64_t>(signed_difference >> 63);
}

std::uint64_t Unfold(std::uint64_t folded) { return (folded >> 1) ^ (~(folded & 1) + 1); }

}  // namespace

std::string EncodeSamples(const RecordedSamples& samples) {
  ByteWriter writer;
  const std::size_t count = samples.size();
  writer.Put(static_cast<std::uint32_t>(count));
  std::string columns(count * kSizes.bytes, '\0');
  std::array<std::uint64_t, kSizes.fields> last{};
  for (std::size_t n = 0; n < count; ++n) {
    std::size_t f = 0;
    VisitColumns(samples[n], count, [&](const auto& field, std::size_t offset) {
      const std::uint64_t word = ToWord(field);
      const std::uint64_t folded = Fold(word - last[f], sizeof field);
      for (std::size_t k = 0; k < sizeof field; ++k) {
        columns[offset + k * count + n] = static_cast<char>(folded >> (8 * k));
      }
      last[f++] = word;
    });
  }
  writer.PutBytes(columns);
  return std::move(writer).Take();
}

RecordedSamples DecodeSamples(std::string_view bytes) {
  ByteReader reader(bytes);
  const std::size_t count = reader.Get<std::uint32_t>();
  if (count == 0 || count > kSamplesPerChunk) throw DamagedBytes("damaged: too many samples");
  const std::string_view columns = reader.GetBytes(count * kSizes.bytes);
  reader.ExpectEnd();
  RecordedSamples samples(count);
  std::array<std::uint64_t, kSizes.fields> last{};
  for (std::size_t n = 0; n < count; ++n) {
    std::size_t f = 0;
    VisitColumns(samples[n], count, [&](auto& field, std::size_t offset) {
      std::uint64_t folded = 0;
      for (std::size_t k = 0; k < sizeof field; ++k) {
        folded |= std::uint64_t{static_cast<unsigned char>(columns[offset + k * count + n])}
                  << (8 * k);
      }
      constexpr std::uint64_t kMask = ~std::uint64_t{0} >> (64 - 8 * sizeof field);
      last[f] = (last[f] + Unfold(folded)) & kMask;
      FromWord(last[f++], field);
    });
    if (samples[n].tick != samples[0].tick + n) throw DamagedBytes("damaged: ticks are missing");
  }
  return samples;
}

}  // namespace palpate
