// `palpate load`, `upload`, `download` and `series`.
#include <fmt/core.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/isovalues.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/set_command.h"
#include "client/files/download_file.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

// The values of the options.
struct LoadValues {
  std::string source;
  client::LoadOptions options;
  std::vector<std::string> settings;    // KEY=VALUE, checked
  std::vector<double> spacing_mm;       // three or none
  std::vector<std::uint32_t> raw_size;  // three or none
  std::string raw_type;
  client::RawVoxels raw;
};

arguments::Validator VoxelTypeName() {
  return {[](const std::string& text) {
    return Named<VoxelType>(text) ? std::string()
                                  : "'" + text +
                                        "' is no type of voxels: give int8, uint8, int16, "
                                        "uint16, int32, uint32, float32 or float64";
  }};
}

// A setting and its value, as in `palpate set`.
arguments::Validator SettingText() {
  return {[](const std::string& text) -> std::string {
    client::SettingsUpdate unused;
    try {
      StoreNamedSetting(text, unused);
    } catch (const arguments::UsageError& error) {
      return error.what();
    }
    return "";
  }};
}

void AddRawOptions(arguments::Command& command, LoadValues& values) {
  arguments::Option* size = command
                                .add_option("--raw-size", values.raw_size,
                                            "The file holds only this many voxels, x fastest")
                                ->delimiter(',')
                                ->expected(3)
                                ->check(arguments::Positive())
                                ->option_text("X,Y,Z");
  arguments::Option* type =
      command
          .add_option("--raw-type", values.raw_type,
                      "Their type: int8, uint8, int16, uint16, int32, uint32,\n"
                      "float32 or float64")
          ->check(VoxelTypeName())
          ->option_text("TYPE");
  size->needs(type);
  type->needs(size);
  command
      .add_flag("--raw-big-endian", values.raw.big_endian,
                "The high byte of each voxel comes first")
      ->needs(size);
  command
      .add_option("--raw-offset-bytes", values.raw.offset_bytes,
                  "Bytes before the first voxel [default: 0]")
      ->check(arguments::NonNegativeNumber())
      ->needs(size)
      ->option_text("N");
}

void AddFrameOption(arguments::Command& command, LoadValues& values) {
  command
      .add_option("--frame", values.options.frame,
                  "For a file with several volumes: which one, from 0 [default: 0]")
      ->option_text("N");
}

void PrintLoaded(const client::LoadResult& result) {
  PrintWarnings(result.volume);
  std::string isovalue;
  AppendLine(isovalue, "", DescribeIsovalue(result.volume, result.isovalue));
  WriteOutput(Describe(result.volume) + isovalue +
              fmt::format("applied at tick {}, settings revision {}\n", result.applied_tick,
                          result.settings_revision));
}

// Adds all options except the source and the frame.
void AddVolumeOptions(arguments::Command& command, LoadValues& values) {
  client::LoadOptions& options = values.options;
  arguments::Option* isovalue =
      command.add_option("--isovalue", options.isovalue, "Isovalue to start with, in data units")
          ->check(arguments::Finite());
  command
      .add_option("--normalized-isovalue", options.normalized_isovalue,
                  "Isovalue to start with, 0 to 1 over the new volume's range\n"
                  "[default: the first that `palpate info` suggests]")
      ->check(arguments::Finite())
      ->excludes(isovalue);
  command
      .add_option("--spacing-mm", values.spacing_mm,
                  "Voxel spacing X,Y,Z in mm, instead of the file's")
      ->delimiter(',')
      ->expected(3)
      ->check(arguments::Positive())
      ->option_text("X,Y,Z");
  command
      .add_option("--device-mm-per-volume-mm", options.device_mm_per_volume_mm,
                  "mm of the device per mm of the volume [default: fits the workspace]")
      ->check(arguments::Positive());
  command
      .add_option("--grid", options.grid,
                  "Which grid of a .vdb file with several: its name,\n"
                  "or NAME[K] where several have one name")
      ->option_text("NAME");
  command
      .add_option("--component", options.component, "Of a grid of vectors: magnitude, x, y or z")
      ->option_text("NAME");
  command
      .add_option("--set", values.settings,
                  "A setting to change at the same tick, as in `palpate set`:\n"
                  "stiffness=0.8. May be given several times.")
      ->expected(1)
      ->take_all()
      ->check(SettingText())
      ->option_text("KEY=VALUE");
  command.add_flag("--discard", options.discard_edits,
                   "Drop edits of the present volume that are not saved");
  AddRawOptions(command, values);
}

client::LoadOptions OptionsOf(const LoadValues& values) {
  client::LoadOptions options = values.options;
  for (const std::string& setting : values.settings) {
    StoreNamedSetting(setting, options.settings);
  }
  if (!values.spacing_mm.empty()) options.spacing_mm = VectorOf(values.spacing_mm);
  if (values.raw_size.empty()) return options;
  options.raw = values.raw;
  for (int axis = 0; axis < 3; ++axis) {
    constexpr std::uint32_t kMost = std::numeric_limits<int>::max();
    options.raw->size[axis] =
        static_cast<int>(std::min(kMost, values.raw_size[static_cast<std::size_t>(axis)]));
  }
  options.raw->type = *Named<VoxelType>(values.raw_type);
  return options;
}

}  // namespace

void AddLoad(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "load",
      "Replaces the volume. The volume felt so far stays until the new one is complete, and\n"
      "stays when loading fails. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate load scan.nrrd --isovalue -200\n"
            "          palpate load builtin:sphere:64 --normalized-isovalue 0.5\n"
            "          palpate load a.raw --raw-size 256,256,128 --raw-type uint16");
  const auto values = std::make_shared<LoadValues>();
  command
      ->add_option("source", values->source,
                   "File or DICOM folder on the daemon's machine, or builtin:NAME[:N]")
      ->required()
      ->option_text("SOURCE");
  AddVolumeOptions(*command, *values);
  AddFrameOption(*command, *values);
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) {
      const std::string source = SourceThere(palpated, values->source);
      PrintLoaded(WithProgress([&](const auto& progress) {
        return palpated.LoadVolume(source, OptionsOf(*values), progress);
      }));
    };
  });
}

void AddUpload(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "upload",
      "Sends a volume of this machine to the daemon, which then replaces its volume by it, or\n"
      "keeps the one before where anything fails. Any format of one file that `load` reads, or\n"
      "the folder of a DICOM series.\n"
      "Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate upload head.nii.gz --isovalue 300 --server scanner:7400\n"
            "          palpate upload CT/");
  const auto values = std::make_shared<LoadValues>();
  command->add_option("file", values->source, "File or DICOM folder to send")
      ->required()
      ->option_text("FILE");
  AddVolumeOptions(*command, *values);
  AddFrameOption(*command, *values);
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) {
      PrintLoaded(WithProgress([&](const auto& progress) {
        return palpated.UploadVolume(values->source, OptionsOf(*values), progress);
      }));
    };
  });
}

namespace {

std::string Summary(const client::DownloadedFile& written, const std::string& file) {
  const client::VolumeMirror& volume = written.copy.volume;
  const VolumeLattice& lattice = *volume.lattice();
  return fmt::format(
      "{}: {} x {} x {} voxels of {} at volume revision {}; {:.1f} MB received in {:.2f} s\n",
      OneLine(file), lattice.size.x(), lattice.size.y(), lattice.size.z(), OneLine(lattice.source),
      volume.resume()->volume_revision, static_cast<double>(written.copy.bytes_received) * 1e-6,
      written.received_s);
}

void Download(client::Calls& palpated, const std::string& file, bool overwrite) {
  WriteOutput(WithProgress([&](const client::ProgressFunction& progress) {
    const auto check = [] {
      if (Interrupt::IsRaised()) {
        throw Error(ErrorKind::kCancelled, "the download was cancelled; no file was written");
      }
    };
    return Summary(client::DownloadToFile(palpated, file, overwrite, progress, check), file);
  }));
}

}  // namespace

void AddDownload(arguments::Command& app, Invocation& invocation) {
  struct Values {
    std::string file;
    bool overwrite = false;
  };
  arguments::Command* command = app.add_subcommand(
      "download",
      "Copies the volume as it is now, with its edits, into a file on this machine: .nrrd (dense,\n"
      "of the smallest type that holds all voxels) or .vdb (OpenVDB, sparse).\n"
      "A lost connection is tried again. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate download scan.nrrd\n"
            "          palpate download surface.vdb");
  const auto values = std::make_shared<Values>();
  command->add_option("file", values->file, "File to write; ends with .nrrd or .vdb")
      ->required()
      ->option_text("FILE");
  command->add_flag("--overwrite", values->overwrite, "Replace a file that is there");
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) {
      Download(palpated, values->file, values->overwrite);
    };
  });
}

namespace {

// applied_tick: of a change.
using AppliedTick = std::optional<std::uint64_t>;

Json SeriesJson(const client::SeriesState& series, AppliedTick applied_tick) {
  Json object = ToJson(series);
  if (applied_tick) object["applied_tick"] = *applied_tick;
  return object;
}

std::string DescribeSeries(const client::SeriesState& series, AppliedTick applied_tick) {
  std::string text = fmt::format(
      "{:<10}frame {:.6g} of 0 to {}, {} at {:g} frames/s{}{}; {:.1f} MiB{}\n", "series",
      series.position_frames, series.frames > 0 ? series.frames - 1 : 0,
      series.playing ? "playing" : "paused", series.rate_hz, series.loop ? ", in a loop" : "",
      series.interpolate ? ", interpolated" : "",
      static_cast<double>(series.memory_bytes) / (1024.0 * 1024.0), OfReplay(series.replayed));
  if (applied_tick) {
    text += fmt::format("applied at tick {}, volume revision {}\n", *applied_tick,
                        series.volume_revision);
  }
  return text;
}

void PrintSeries(const client::SeriesState& series, AppliedTick applied_tick, bool json) {
  WriteOutput(json ? ToText(SeriesJson(series, applied_tick))
                   : DescribeSeries(series, applied_tick));
}

struct SeriesValues {
  std::vector<std::string> files;
  LoadValues load;
  double number = 0.0;
  std::string on_or_off;
};
using SeriesValuesPtr = std::shared_ptr<SeriesValues>;

void Load(client::Calls& palpated, const SeriesValues& values) {
  std::vector<std::string> sources;
  for (const std::string& file : values.files) sources.push_back(SourceThere(palpated, file));
  const client::SeriesResult result = WithProgress([&](const auto& progress) {
    return palpated.LoadSeries(sources, OptionsOf(values.load), progress);
  });
  PrintWarnings(result.volume);
  WriteOutput(Describe(result.volume) + DescribeSeries(result.series, result.applied_tick));
}

void AddSeriesLoad(arguments::Command& series, Invocation& invocation,
                   const SeriesValuesPtr& values) {
  arguments::Command* command = series.add_subcommand(
      "load",
      "Loads all frames, replaces the volume by the first and pauses there. The volume felt so\n"
      "far stays until then, and when loading fails. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate series load t1.nrrd t2.nrrd t3.nrrd\n"
            "          palpate series load '/data/run7/t*.nrrd' --isovalue 35\n"
            "          palpate series load functional.nii");
  command
      ->add_option("files", values->files,
                   "Files of one frame each, in the order of time, or one file with several, on\n"
                   "the daemon's machine. In quotes a name may be a pattern with * and ?: its\n"
                   "matches come in the order of the numbers in their names.")
      ->required()
      ->option_text("FILES");
  AddVolumeOptions(*command, values->load);
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) { Load(palpated, *values); };
  });
}

// Adds a command that changes how the series plays.
arguments::Command* AddControl(arguments::Command& series, Invocation& invocation,
                               const std::string& name, const std::string& about,
                               const std::string& example,
                               const std::function<client::SeriesControl()>& control) {
  arguments::Command* command = series.add_subcommand(name, about);
  SetFooter(*command, "Example: palpate series " + example);
  AddJson(*command, invocation);
  command->callback([&invocation, control] {
    invocation.command = [&invocation, control](client::Calls& palpated) {
      const client::SeriesControlled now = palpated.ControlSeries(control());
      PrintSeries(now.series, now.applied_tick, invocation.json);
    };
  });
  return command;
}

void AddSwitch(arguments::Command& series, Invocation& invocation, const SeriesValuesPtr& values,
               const std::string& name, const std::string& about,
               std::optional<bool> client::SeriesControl::*member) {
  AddControl(series, invocation, name, about, name + " on",
             [values, member] {
               client::SeriesControl control;
               control.*member = values->on_or_off == "on";
               return control;
             })
      ->add_option("on_or_off", values->on_or_off, "on or off")
      ->required()
      ->check(arguments::IsMember({"on", "off"}))
      ->option_text("on|off");
}

void AddControls(arguments::Command& series, Invocation& invocation,
                 const SeriesValuesPtr& values) {
  using Control = client::SeriesControl;
  AddControl(series, invocation, "play", "Plays, from the end again from the beginning", "play",
             [] { return Control{.playing = true}; });
  AddControl(series, invocation, "pause", "Stays at the frame that is shown", "pause",
             [] { return Control{.playing = false}; });
  AddControl(series, invocation, "seek", "Goes to a frame", "seek 2.5",
             [values] { return Control{.position_frames = values->number}; })
      ->add_option("position", values->number,
                   "In frames, 0 the first; between two where the series is interpolated")
      ->required()
      ->check(arguments::Finite())
      ->option_text("N");
  AddControl(series, invocation, "rate", "Sets how fast it plays", "rate -5",
             [values] { return Control{.rate_hz = values->number}; })
      ->add_option("rate_hz", values->number,
                   "Frames per second, negative backwards: -1000 to 1000, not 0")
      ->required()
      ->check(arguments::Finite())
      ->option_text("HZ");
  AddSwitch(series, invocation, values, "loop", "At the end: begin again, or stop there",
            &Control::loop);
  AddSwitch(series, invocation, values, "interpolate", "Blends neighbouring frames in time",
            &Control::interpolate);
}

}  // namespace

void AddSeries(arguments::Command& app, Invocation& invocation) {
  arguments::Command* series =
      app.add_subcommand("series", "A time series under the stylus: load, play, pause, seek");
  SetFooter(*series, "Example: palpate series load 't*.nrrd' && palpate series play");
  series->require_subcommand(1);
  const auto values = std::make_shared<SeriesValues>();
  AddSeriesLoad(*series, invocation, values);
  AddControls(*series, invocation, values);
  arguments::Command* info = series->add_subcommand("info", "Shows what is played, and how");
  SetFooter(*info, "Example: palpate series info --json");
  AddJson(*info, invocation);
  info->callback([&invocation] {
    invocation.command = [&invocation](client::Calls& palpated) {
      PrintSeries(palpated.GetSeries(), std::nullopt, invocation.json);
    };
  });
}

}  // namespace palpate::cli
