// Samples and outputs for tests of recordings.
#pragma once

#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "server/recording/recording_reader.h"
#include "server/recording/recording_writer.h"
#include "server/recording/sample_fields.h"

namespace palpate::testing {

// All fields except the tick have random bits, including NaNs, as far as a tick can have them.
inline TickSample RandomSample(std::uint64_t tick) {
  std::mt19937_64 random(tick + 1);
  TickSample sample;
  VisitFields(sample, [&](std::string_view, auto& field) {
    using Field = std::decay_t<decltype(field)>;
    const std::uint64_t bits = random();
    if constexpr (std::is_enum_v<Field>) {
      field = static_cast<Field>(1 + bits % kWords<Field>.size());
    } else if constexpr (std::is_same_v<Field, bool>) {
      field = bits % 2 != 0;
    } else {
      std::memcpy(&field, &bits, sizeof field);
    }
  });
  sample.tick = tick;
  if (!sample.contact) sample.scp_h_normal = {};
  if (!sample.has_scp_v) sample.scp_v_mm = sample.scp_v_normal = {};
  const auto there_or_not = [&](auto... component) {
    const bool is_there = random() % 2 == 0;
    ((*component = is_there ? static_cast<double>(random()) : TickSample::kNone), ...);
  };
  for (auto* v : {&sample.led_target_mm, &sample.push_n}) {
    there_or_not(&(*v)[0], &(*v)[1], &(*v)[2]);
  }
  auto& q = sample.tool_orientation;
  there_or_not(&q[0], &q[1], &q[2], &q[3]);
  there_or_not(&sample.series_position_frames);
  sample.hand = 0;
  return sample;
}

// Compares bit for bit.
inline bool SameSample(const TickSample& a, const TickSample& b) {
  const auto bits = [](const TickSample& sample) {
    std::string bytes;
    VisitFields(sample, [&](std::string_view, const auto& field) {
      bytes.append(reinterpret_cast<const char*>(&field), sizeof field);
    });
    return bytes;
  };
  return bits(a) == bits(b);
}

class MemoryOutput : public RecordingOutput {
 public:
  explicit MemoryOutput(std::shared_ptr<std::string> bytes) : bytes_(std::move(bytes)) {}
  void Append(std::string_view bytes) override { bytes_->append(bytes); }
  void Sync() override {}

 private:
  std::shared_ptr<std::string> bytes_;
};

// All fields except the tick have random bits.
inline std::vector<TickSample> RandomSamples(std::uint64_t first, std::size_t count) {
  std::vector<TickSample> samples;
  for (std::size_t n = 0; n < count; ++n) samples.push_back(RandomSample(first + n));
  return samples;
}

// Writes them at once, in chunks as long as a recorder's.
inline void Append(RecordingWriter& writer, const std::vector<TickSample>& samples) {
  for (const TickSample& sample : samples) {
    writer.Append(sample);
    if (writer.waiting_ticks() == kSamplesPerChunk) writer.EndChunk();
  }
  writer.EndChunk();
}

inline RecordingReader ReadBytes(const std::string& bytes) {
  return RecordingReader(std::make_unique<std::istringstream>(bytes), "test");
}

inline std::vector<RecordedItem> ReadAll(RecordingReader& reader) {
  std::vector<RecordedItem> items;
  while (std::optional<RecordedItem> item = reader.Next()) items.push_back(std::move(*item));
  return items;
}

// The items of one kind, in their order.
template <typename Item>
std::vector<Item> Only(const std::vector<RecordedItem>& items) {
  std::vector<Item> only;
  for (const RecordedItem& item : items) {
    if (const auto* one = std::get_if<Item>(&item)) only.push_back(*one);
  }
  return only;
}

inline std::vector<TickSample> SamplesIn(const std::vector<RecordedItem>& items) {
  std::vector<TickSample> samples;
  for (const RecordedSamples& some : Only<RecordedSamples>(items)) {
    samples.insert(samples.end(), some.begin(), some.end());
  }
  return samples;
}

inline LeafPtr FilledLeaf(float value) {
  Brick brick{};
  brick.fill(value);
  return Leaf::Of(LeafType::kFloat, brick);
}

}  // namespace palpate::testing
