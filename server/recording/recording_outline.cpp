#include "server/recording/recording_outline.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <variant>

#include "common/error/error.h"

namespace palpate {

RecordingOutline ReadOutline(RecordingReader& reader, const std::function<bool()>& cancelled) {
  // Of a marker without a text, too.
  constexpr std::size_t kBytesPerMarker = 16;
  RecordingOutline outline;
  std::vector<std::int64_t> times_ns;  // of the markers
  std::size_t placed = 0, bytes = 0;
  const auto place_next = [&] {
    outline.markers[placed++].tick = std::max<std::uint64_t>(outline.ticks, 1) - 1;
  };
  while (std::optional<RecordedChunk> chunk = reader.Next()) {
    if (cancelled()) throw Error(ErrorKind::kCancelled, "the replay was cancelled");
    if (const auto* samples = std::get_if<RecordedSamples>(&*chunk)) {
      for (const TickSample& sample : *samples) {
        while (placed < times_ns.size() && times_ns[placed] < sample.time_ns) place_next();
        ++outline.ticks;
      }
    }
    auto* const marker = std::get_if<TimedMarker>(&*chunk);
    if (!marker) continue;
    bytes += marker->text.size() + kBytesPerMarker;
    if (bytes > kMostOutlineBytes) continue;
    times_ns.push_back(marker->time_ns);
    outline.markers.push_back({.text = std::move(marker->text)});
  }
  while (placed < times_ns.size()) place_next();
  return outline;
}

}  // namespace palpate
