#include "server/lab/recording_command.h"

#include <fmt/core.h>

#include <cstdio>
#include <fstream>
#include <optional>
#include <ostream>
#include <utility>

#include "common/error/error.h"
#include "server/recording/csv_export.h"
#include "server/recording/recording_reader.h"
#include "server/recording/replayer.h"

namespace palpate::lab {
namespace {

RecordedVolumeLoader LoaderOf(const RecordingReplayOptions& options) {
  return [first = options.volume,
          import_program = options.import_program](const RecordedScene& scene) mutable {
    const std::string given = std::exchange(first, {});
    return LoadVolume(given.empty() ? scene.volume_source : given, import_program, {},
                      scene.spacing_mm);
  };
}

void WarnIfCut(const RecordingReader& reader) {
  if (reader.complete()) return;
  std::fprintf(stderr, "palpate-lab: %s\n", reader.stopped_because().c_str());
}

std::string Report(const ReplayCounts& counts) {
  std::string text = fmt::format(
      "ticks      {}\ncompared   {}, {} in contact\ndiffering  {}\n"
      "states     {} compared, {} differing\n",
      counts.ticks, counts.compared, counts.contacts, counts.differing, counts.keyframes,
      counts.differing_keyframes);
  text += fmt::format("gaps       {}, {} ticks lost\nscenes     {}\nedits      {} applied\n",
                      counts.gaps, counts.lost_ticks, counts.scenes, counts.edits);
  text += fmt::format("markers    {}\n", counts.markers);
  if (counts.compared == counts.ticks) return text;
  return text + fmt::format(
                    "left out   {} ticks before a state to start from, {} without their scene, "
                    "{} without their volume\n",
                    counts.without_start, counts.without_scene, counts.without_volume);
}

}  // namespace

void ReplayRecording(const RecordingReplayOptions& options, std::ostream& out) {
  RecordingReader reader(options.recording);
  Replayer replayer(LoaderOf(options));
  while (const std::optional<RecordedChunk> chunk = reader.Next()) replayer.Take(*chunk);
  const ReplayCounts& counts = replayer.counts();
  out << Report(counts);
  WarnIfCut(reader);
  if (const auto& first = replayer.first_difference()) {
    throw Error(
        ErrorKind::kInternal,
        fmt::format("{} ticks differ; the first is tick {}, whose {} was {} and is {}",
                    counts.differing, first->tick, first->field, first->recorded, first->computed));
  }
  if (counts.differing_keyframes > 0) {
    throw Error(ErrorKind::kInternal, "the state of the servo differs, though no tick does");
  }
  if (counts.without_volume > 0) {
    std::fprintf(stderr, "palpate-lab: ticks were left out: %s\n", replayer.volume_error()->what());
  }
  if (counts.compared == 0) {
    if (replayer.volume_error()) throw *replayer.volume_error();
    throw Error(ErrorKind::kConflict, "no tick could be compared: the recording is too short");
  }
}

void ExportRecording(const ExportOptions& options, std::ostream& out) {
  RecordingReader reader(options.recording);
  if (options.output.empty()) {
    ExportCsv(reader, out);
  } else {
    std::ofstream file(options.output);
    if (!file) {
      throw Error(ErrorKind::kUnavailable, "cannot write " + options.output.string());
    }
    ExportCsv(reader, file);
  }
  WarnIfCut(reader);
}

}  // namespace palpate::lab
