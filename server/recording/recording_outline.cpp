#include "server/recording/recording_outline.h"

#include <utility>
#include <variant>

#include "common/error/error.h"

namespace palpate {

RecordingOutline ReadOutline(RecordingReader& reader, const std::function<bool()>& cancelled) {
  // Of a marker without a text, too.
  constexpr std::size_t kBytesPerMarker = 16;
  RecordingOutline outline;
  std::size_t bytes = 0;
  while (std::optional<RecordedItem> item = reader.Next()) {
    if (cancelled()) throw Error(ErrorKind::kCancelled, "the replay was cancelled");
    if (const auto* samples = std::get_if<RecordedSamples>(&*item)) {
      outline.ticks += samples->size();
    }
    auto* const event = std::get_if<RecordedEvent>(&*item);
    if (!event) continue;
    bytes += event->marker.size() + kBytesPerMarker;
    if (bytes > kMostOutlineBytes) continue;
    // It comes before the sample of its tick.
    outline.markers.push_back({.tick = outline.ticks, .text = std::move(event->marker)});
  }
  return outline;
}

}  // namespace palpate
