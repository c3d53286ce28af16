#include "server/lab/commands.h"

#include <fmt/core.h>

#include <cstdio>
#include <fstream>
#include <optional>
#include <ostream>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/recording/csv_export.h"
#include "server/recording/recording_reader.h"
#include "server/recording/replayer.h"

namespace palpate::lab {
namespace {

[[noreturn]] void ThrowNotHeld(const RecordedScene& scene) {
  throw Error(ErrorKind::kNotFound,
              (scene.volume_source.empty() ? "the volume" : scene.volume_source) +
                  " is not in the recording (it is too large, or the recording is old), and cannot "
                  "be loaded again: if it was uploaded, give the uploaded file with --volume; "
                  "ticks of series, raw voxels and single frames cannot be computed again");
}

RecordedVolumeLoader LoaderOf(const RecordingReplayOptions& options) {
  return [first = options.volume,
          import_program = options.import_program](const RecordedScene& scene) mutable {
    if (scene.all_voxels_stored) return WithoutVoxels(scene);
    const std::string given = std::exchange(first, {});
    const bool can_be_loaded = scene.reloadable && !scene.volume_source.empty();
    if (given.empty() && !can_be_loaded) ThrowNotHeld(scene);
    return LoadVolume(given.empty() ? scene.volume_source : given, import_program, {},
                      scene.spacing_mm);
  };
}

void WarnIfCut(const RecordingReader& reader) {
  if (reader.complete()) return;
  std::fprintf(stderr, "palpate-lab: %s\n", reader.stopped_because().c_str());
}

// On standard error, because the table may go to standard output. Ticks may be lost at the end,
// where no row counts them.
void SayWhatIsMissing(const RecordingReader& reader) {
  const char* where = reader.lost_ticks() > 0 ? " (the column lost_ticks says where)" : "";
  fmt::print(stderr, "{} ticks, {} missing{}\n", reader.ticks(), reader.lost_ticks(), where);
  WarnIfCut(reader);
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

// Ticks before the first state cannot be computed, but are no error: any recording has a few.
void CheckMissing(const Replayer& replayer, bool is_allowed) {
  const ReplayCounts& counts = replayer.counts();
  const std::uint64_t missing = counts.without_volume + counts.without_scene;
  if (missing == 0) return;
  const std::string why =
      replayer.volume_error() ? replayer.volume_error()->what() : "their scene is missing";
  const std::string text =
      fmt::format("{} of {} ticks could not be computed again: {}", missing, counts.ticks, why);
  if (!is_allowed) throw Error(ErrorKind::kConflict, text + "; --allow-missing accepts this");
  std::fprintf(stderr, "palpate-lab: %s\n", text.c_str());
}

}  // namespace

void ReplayRecording(const RecordingReplayOptions& options, std::ostream& out) {
  RecordingReader reader(options.recording);
  Replayer replayer(LoaderOf(options));
  while (const std::optional<RecordedItem> item = reader.Next()) replayer.Take(*item);
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
    throw Error(ErrorKind::kInternal, "the state of the servo differs, although no tick differs");
  }
  if (counts.compared == 0) {
    if (replayer.volume_error()) throw *replayer.volume_error();
    throw Error(ErrorKind::kConflict, "no tick could be compared: the recording is too short");
  }
  CheckMissing(replayer, options.allow_missing);
}

void ExportRecording(const ExportOptions& options, std::ostream& out) {
  if (options.hdf5) {
    throw Error(ErrorKind::kInvalidArgument,
                "the Python package writes HDF5: python3 -c 'import palpate, sys; "
                "palpate.open_recording(sys.argv[1]).to_hdf5(sys.argv[2])' RECORDING FILE.h5");
  }
  RecordingReader reader(options.recording);
  if (options.output.empty()) {
    ExportCsv(reader, out);
  } else {
    const auto write = [&](const std::filesystem::path& partial) {
      std::ofstream file;
      file.exceptions(std::ios::failbit | std::ios::badbit);
      file.open(partial);
      ExportCsv(reader, file);
      file.close();
    };
    WriteWhole(options.output, write, ReplacesIf(options.overwrite));
  }
  SayWhatIsMissing(reader);
}

}  // namespace palpate::lab
