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
  while (std::optional<RecordedChunk> chunk = reader.Next()) {
    if (cancelled()) throw Error(ErrorKind::kCancelled, "the replay was cancelled");
    auto* const marker = std::get_if<RecordedMarker>(&*chunk);
    if (!marker) continue;
    bytes += marker->text.size() + kBytesPerMarker;
    if (bytes <= kMostOutlineBytes) {
      outline.markers.push_back({reader.ticks(), std::move(marker->text)});
    }
  }
  outline.ticks = reader.ticks();
  return outline;
}

}  // namespace palpate
