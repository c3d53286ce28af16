#include "client/cli/load_command.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string_view>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/isovalues.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/progress.h"
#include "client/cli/set_command.h"

namespace palpate::cli {
namespace {

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

}  // namespace

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

}  // namespace palpate::cli
