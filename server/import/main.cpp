// palpate-import: reads a volume file that may be damaged or hostile, and hands the volume over to
// the daemon (server/volume/load/handover.h) or writes a .vdb file
// (server/volume/save/volume_file.h). Also writes the .vdb files of the daemon
// (server/volume/save/volume_pipe.h).

#include <signal.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <ios>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "server/import/confinement.h"
#include "server/import/readers.h"
#include "server/import/reporter.h"
#include "server/import/tiff_stack.h"
#include "server/import/voxel_writer.h"
#include "server/volume/load/handover.h"
#include "server/volume/save/volume_file.h"
#include "server/volume/save/volume_pipe.h"

namespace {

namespace arguments = palpate::arguments;
using palpate::ErrorKind;
using palpate::ExitCode;

struct Options {
  std::string input;
  std::string output;
  bool overwrite = false;
  std::optional<std::int64_t> descriptor;
  std::optional<std::int64_t> save_descriptor;
  std::vector<double> spacing_mm;
  std::string rescale;
  std::string orientation;
  std::string series;
  std::string acquisition;
  bool no_resample = false;
  std::optional<std::int64_t> frame;
  std::string grid;
  std::string component;
  std::vector<std::int64_t> raw_size;
  palpate::RawVoxels raw;
  std::vector<std::string> folders;
  std::vector<std::string> own_files;
  std::int64_t max_voxels = palpate::ImportLimits{}.max_voxels;
  std::int64_t max_memory_mib = palpate::ImportLimits{}.max_memory_bytes >> 20;
  unsigned timeout_s = 300;
  bool progress = false;
};

void DefineLimits(arguments::Command* app, Options* options) {
  app->add_option("--max-voxels", options->max_voxels, "Refuse larger volumes")
      ->check(arguments::PositiveNumber())
      ->type_name("N")
      ->capture_default_str();
  app->add_option("--max-memory-mib", options->max_memory_mib,
                  "Refuse volumes that need more memory, in MiB (6 to 12 bytes per voxel)")
      ->check(arguments::Range(std::int64_t{1}, std::int64_t{1} << 30))
      ->type_name("N")
      ->capture_default_str();
  app->add_option("--only-below", options->folders,
                  "Read INPUT, its slices and data files only below INPUT's folder or this\n"
                  "folder, after links are followed. The folders' own paths must hold no links.\n"
                  "May be given again (default: anywhere). With --to-descriptor the kernel\n"
                  "enforces this")
      ->expected(1)
      ->take_all()
      ->type_name("FOLDER");
  app->add_option("--never", options->own_files,
                  "With --only-below: refuse this file or folder, also under another name; may be\n"
                  "given again")
      ->expected(1)
      ->take_all()
      ->type_name("PATH");
  app->add_option("--timeout-s", options->timeout_s, "Give up after this many seconds")
      ->check(arguments::Range(1u, 1000000u))
      ->type_name("N")
      ->capture_default_str();
}

void DefineRawOptions(arguments::Command* app, Options* options) {
  arguments::Option* const size =
      app->add_option("--raw-size", options->raw_size,
                      "INPUT is raw voxels: their number along x, y, z; x fastest")
          ->delimiter(',')
          ->expected(3)
          ->type_name("X,Y,Z");
  arguments::Option* const type =
      app->add_option("--raw-type", options->raw.type,
                      "int8, uint8, int16, uint16, int32, uint32, float32 or float64")
          ->type_name("TYPE");
  size->needs(type);
  type->needs(size);
  app->add_flag("--raw-big-endian", options->raw.big_endian, "Raw voxels are big endian")
      ->needs(size);
  app->add_option("--raw-offset", options->raw.offset_bytes, "Bytes before the first raw voxel")
      ->needs(size)
      ->type_name("BYTES");
}

void DefineOptions(arguments::Command* app, Options* options) {
  app->description(
      "Reads a volume and writes it as OpenVDB.\n\n"
      "INPUT is one of: NRRD (.nrrd, .nhdr; raw or gzip), MetaImage (.mha, .mhd), NIfTI-1 and -2\n"
      "(.nii, .nii.gz), OpenVDB (.vdb), a TIFF stack (.tif, .tiff: a file of\n"
      "several pages, the first file of a numbered series, or its folder), a\n"
      "folder with a DICOM series, or raw voxels (--raw-size, --raw-type). Voxels are 8, 16 or 32\n"
      "bit integers, float or double. OUTPUT keeps 8 and 16 bits; others become 32 bit floats.\n"
      "A volume has three axes of at least 2 voxels; NRRD and NIfTI may also have time. Lengths\n"
      "are in mm, the frame is LPS.");
  app->footer(
      "Exit codes: 0 written; 2 wrong usage; 3 not a volume, damaged or not supported; 4 not "
      "found;\n"
      "5 permission denied; 6 over a limit; 8 cannot write; 11 disk full; 1 any other failure.\n"
      "Example: palpate-import head.nii.gz head.vdb --max-memory-mib 4096");
  app->add_option("INPUT", options->input, "Volume file, or folder of a series")->required();
  arguments::Option* const output = app->add_option("OUTPUT", options->output, "File to write");
  app->add_option("--to-descriptor", options->descriptor,
                  "Instead of OUTPUT: hand the volume to palpated in this open file in memory")
      ->excludes(output)
      ->type_name("FD");
  app->add_option("--save-to-descriptor", options->save_descriptor,
                  "Instead of OUTPUT: write the volume that palpated sends to standard input into\n"
                  "this open file. INPUT is its name in messages")
      ->excludes(output)
      ->type_name("FD");
  app->add_flag("--overwrite", options->overwrite, "Replace OUTPUT if it is there")->needs(output);
  app->add_option("--spacing-mm", options->spacing_mm,
                  "Distance of voxels along x,y,z in mm, instead of the file's")
      ->delimiter(',')
      ->expected(3)
      ->type_name("X,Y,Z");
  app->add_option(
         "--rescale", options->rescale,
         "Values are INTERCEPT + SLOPE * what the file says (default slope: 1). Those of a\n"
         "CT are then taken for Hounsfield units: --rescale -1024")
      ->type_name("INTERCEPT[,SLOPE]");
  app->add_option(
         "--orientation", options->orientation,
         "Place of a NIfTI file's voxels: its qform, its sform (at right angles), or none\n"
         "(default: the sform if its code is not 0, else the qform)")
      ->check(arguments::IsMember({"qform", "sform", "none"}))
      ->type_name("FORM");
  app->add_option("--series", options->series,
                  "SeriesInstanceUID of the DICOM series to read (default: the one with the most\n"
                  "slices that fit together)")
      ->type_name("UID");
  app->add_option("--acquisition", options->acquisition,
                  "Pass of the DICOM series to read, as the warning numbers them, if several lie\n"
                  "over the same range (acquisitions, times, echoes); all: they are one volume")
      ->type_name("N");
  app->add_flag("--no-resample", options->no_resample,
                "Refuse unevenly spaced DICOM slices (default: interpolate at their finest\n"
                "spacing, with a warning)");
  app->add_option("--frame", options->frame, "Frame of a 4-D file to read, from 0 (default: 0)")
      ->type_name("N");
  app->add_option("--grid", options->grid, "Grid to read, if the .vdb file has several")
      ->type_name("NAME");
  app->add_option("--component", options->component,
                  "Component of a grid of vectors: magnitude, x, y or z")
      ->type_name("NAME");
  DefineRawOptions(app, options);
  DefineLimits(app, options);
  app->add_flag("--progress", options->progress,
                "Print lines 'progress FRACTION STAGE' to stdout, with FRACTION from 0 to 1, and\n"
                "'size X Y Z BYTES' once the size and the bytes of a voxel in the file are known");
}

// "CT/" and "CT" are the same folder.
std::string SourceName(const std::filesystem::path& input) {
  std::error_code error;
  const std::filesystem::path full = std::filesystem::absolute(input, error).lexically_normal();
  return (full.has_filename() ? full : full.parent_path()).filename().string();
}

palpate::VolumeMetadata ReadRaw(const Options& options, const palpate::ImportLimits& limits,
                                const palpate::VoxelSink& sink, palpate::Reporter* reporter) {
  palpate::RawVoxels raw = options.raw;
  std::copy_n(options.raw_size.begin(), raw.size.size(), raw.size.begin());
  if (options.spacing_mm.empty()) {
    reporter->Warn("no spacing is stated; 1 mm is taken, state another one with --spacing-mm");
  }
  return palpate::ReadRawVolume(options.input, raw, limits, sink, reporter);
}

// Reads the other formats of single files.
palpate::VolumeMetadata ReadSingleFile(const Options& options, const palpate::ImportLimits& limits,
                                       const palpate::VoxelSink& sink,
                                       palpate::Reporter* reporter) {
  const std::filesystem::path input = options.input;
  palpate::CheckReadable(input);
  if (palpate::IsTiffName(input)) return palpate::ReadTiffVolume(input, limits, sink, reporter);
  if (palpate::Lower(input.extension().string()) == ".dcm") {
    palpate::Refuse(
        "this is one DICOM file; give the folder of its series (a file with several frames is not "
        "supported: save one file per slice)");
  }
  palpate::Refuse(
      "the format is not known by its name; use .nrrd, .nhdr, .mha, .mhd, .nii, .nii.gz, .vdb, "
      ".tif, .tiff, the folder of a series, or --raw-size and --raw-type");
}

// Returns the format of a file whose voxels we read ourselves.
std::optional<palpate::ImageFormat> PlainFormat(const std::filesystem::path& input) {
  const std::string name = palpate::Lower(input.filename().string());
  const auto ends = [&name](std::string_view ending) { return name.ends_with(ending); };
  if (ends(".nrrd") || ends(".nhdr")) return palpate::ImageFormat::kNrrd;
  if (ends(".mha") || ends(".mhd")) return palpate::ImageFormat::kMetaImage;
  if (ends(".nii") || ends(".nii.gz")) return palpate::ImageFormat::kNifti;
  return std::nullopt;
}

std::optional<palpate::NiftiForm> FormNamed(const std::string& name) {
  if (name.empty()) return std::nullopt;
  return name == "qform"   ? palpate::NiftiForm::kQform
         : name == "sform" ? palpate::NiftiForm::kSform
                           : palpate::NiftiForm::kNone;
}

palpate::VolumeMetadata Read(const Options& options, const palpate::ImportLimits& limits,
                             const palpate::VoxelSink& sink, palpate::Reporter* reporter) {
  const std::filesystem::path input = options.input;
  const bool raw = !options.raw_size.empty();
  std::error_code error;
  const bool folder = std::filesystem::is_directory(input, error);
  const auto format = PlainFormat(input);
  if (!raw && !folder && format) {
    return palpate::ReadPlainVolume(input, *format, options.frame, limits, sink, reporter);
  }
  palpate::CheckFrame(options.frame.value_or(0), 1);
  if (raw) return ReadRaw(options, limits, sink, reporter);
  if (!folder) return ReadSingleFile(options, limits, sink, reporter);
  return palpate::IsTiffFolder(input) ? palpate::ReadTiffVolume(input, limits, sink, reporter)
                                      : palpate::ReadDicomVolume(input, limits, sink, reporter);
}

// The folders as they are named, with links not resolved: a link that is put into such a path later
// leads nowhere.
std::vector<std::filesystem::path> FoldersToRead(const Options& options) {
  if (options.folders.empty()) return {};
  const auto plain = [](const std::filesystem::path& path) {
    const std::filesystem::path full = std::filesystem::absolute(path).lexically_normal();
    return full.has_filename() ? full : full.parent_path();  // without a slash at its end
  };
  std::error_code error;
  const std::filesystem::path input = plain(options.input);
  std::vector<std::filesystem::path> folders{
      std::filesystem::is_directory(input, error) ? input : input.parent_path()};
  for (const std::string& path : options.folders) folders.push_back(plain(path));
  return folders;
}

constexpr char kDicom[] = "DICOM";
constexpr std::int64_t kBricksAtOnce = 1 << 14;  // between two lines of progress

// The format as a crash of its reader names it.
std::string ReaderName(const Options& options) {
  std::error_code error;
  const std::filesystem::path input = options.input;
  const bool is_folder = std::filesystem::is_directory(input, error);
  if (!options.raw_size.empty()) return "raw voxels";
  if (is_folder && !palpate::IsTiffFolder(input)) return kDicom;
  if (is_folder || palpate::IsTiffName(input)) return "TIFF";
  const auto format = PlainFormat(input);
  if (!format) return "OpenVDB";
  return *format == palpate::ImageFormat::kNrrd        ? "NRRD"
         : *format == palpate::ImageFormat::kMetaImage ? "MetaImage"
                                                       : "NIfTI";
}

bool IsVdb(const Options& options) {
  std::error_code error;
  return options.raw_size.empty() &&
         palpate::Lower(std::filesystem::path(options.input).extension().string()) == ".vdb" &&
         !std::filesystem::is_directory(options.input, error);
}

void HandOver(const Options& options, const palpate::ImportLimits& limits,
              const std::optional<palpate::Vec3>& spacing_mm, int fd, palpate::Reporter* reporter) {
  const std::string source = SourceName(options.input);
  if (limits.form &&
      (!options.raw_size.empty() || PlainFormat(options.input) != palpate::ImageFormat::kNifti)) {
    palpate::Refuse("only NIfTI files have a qform and a sform; leave --orientation out");
  }
  if ((!options.series.empty() || !options.acquisition.empty()) && ReaderName(options) != kDicom) {
    palpate::Refuse(
        "only folders of DICOM files have series and passes; leave --series and --acquisition out");
  }
  if (IsVdb(options)) {
    if (limits.rescale) {
      palpate::Refuse("the values of a grid are not rescaled; leave --rescale out");
    }
    palpate::CheckFrame(options.frame.value_or(0), 1);
    palpate::HandOverVdb(options.input, {source, options.grid, options.component, spacing_mm}, fd,
                         reporter);
    return;
  }
  if (!options.grid.empty() || !options.component.empty()) {
    palpate::Refuse("only .vdb files have grids and components; leave --grid and --component out");
  }
  palpate::VoxelWriter writer(fd);
  const auto sink = [&](palpate::LeafType type, const void* voxels, std::size_t count) {
    if (!limits.rescale) return writer.Add(type, voxels, count);
    const auto& [intercept, slope] = *limits.rescale;
    std::vector<float> values = palpate::FloatsOf(type, voxels, count);
    for (float& value : values) value = static_cast<float>(intercept + slope * value);
    writer.Add(palpate::LeafType::kFloat, values.data(), count);
  };
  palpate::ImportLimits with_padding = limits;
  with_padding.on_padding = [&](float value) {
    const auto& [intercept, slope] = limits.rescale.value_or(std::array{0.0, 1.0});
    writer.SetPadding(static_cast<float>(intercept + slope * value));
  };
  palpate::VolumeMetadata metadata = Read(options, with_padding, sink, reporter);
  metadata.source = source;
  writer.Finish(std::move(metadata), spacing_mm, reporter);
}

std::array<double, 2> RescaleOf(std::string text) {
  std::ranges::replace(text, ',', ' ');
  const std::vector<std::string_view> words = palpate::Words(text);
  std::array<double, 2> line = {0.0, 1.0};
  for (std::size_t n = 0; n < words.size() && n < line.size(); ++n) {
    line[n] = palpate::ParseReal(words[n], "--rescale");
  }
  if (words.empty() || words.size() > line.size() || line[1] == 0.0 ||
      !std::isfinite(line[0] + line[1])) {
    palpate::Refuse("--rescale takes a number, and a slope that is not 0: --rescale -1024,1");
  }
  return line;
}

void Import(const Options& options, palpate::Reporter* reporter) {
  std::optional<palpate::Vec3> spacing_mm;
  if (!options.spacing_mm.empty()) {
    spacing_mm = {options.spacing_mm[0], options.spacing_mm[1], options.spacing_mm[2]};
    for (const double spacing : *spacing_mm) palpate::CheckSpacing(spacing);
  }
  palpate::ImportLimits limits;
  limits.max_voxels = options.max_voxels;
  limits.spacing_is_given = spacing_mm.has_value();
  if (!options.rescale.empty()) limits.rescale = RescaleOf(options.rescale);
  limits.form = FormNamed(options.orientation);
  limits.series = options.series;
  limits.acquisition = options.acquisition;
  limits.may_resample = !options.no_resample;
  limits.max_memory_bytes = options.max_memory_mib << 20;
  limits.folders = FoldersToRead(options);
  limits.own_files = palpate::OwnFiles({options.own_files.begin(), options.own_files.end()});
  limits.on_size = [reporter](const auto& size, int bytes) { reporter->Size(size, bytes); };
  if (!options.output.empty()) {
    palpate::CheckNewFile(options.output, palpate::ReplacesIf(options.overwrite));
  }
  reporter->FailOnCrash(
      "the reader of " + ReaderName(options) +
          " crashed; this is a fault of the reader, whatever the file holds: save the volume in "
          "another format (NRRD, NIfTI), and please report this",
      ErrorKind::kInternal);
  reporter->FailAfter(options.timeout_s);
  palpate::LimitResources(limits.max_memory_bytes, options.timeout_s);
  if (!limits.folders.empty()) palpate::CheckPlace(options.input, limits);
  if (options.descriptor) palpate::Confine(limits.folders);
  if (options.descriptor) {
    HandOver(options, limits, spacing_mm, static_cast<int>(*options.descriptor), reporter);
  } else {
    palpate::Descriptor file = palpate::MakeHandoverFile();
    HandOver(options, limits, spacing_mm, file.get(), reporter);
    const palpate::LoadedVolume volume =
        palpate::TakeHandover(file.get(), {.max_voxels = options.max_voxels});
    file.Close();  // frees its memory before the leaves are copied for writing
    palpate::WriteVolumeFile(options.output, volume.bricks, volume.metadata,
                             palpate::ReplacesIf(options.overwrite));
  }
  reporter->Progress(1.0, "done");
}

constexpr char kNoMemoryToSave[] =
    "there is not enough memory to write it; save it as .nrrd, which needs none";

// Receives and writes about as long.
void Save(const Options& options, palpate::Reporter* reporter) {
  // OpenVDB needs memory to give memory back, and crashes without it.
  reporter->FailOnCrash(kNoMemoryToSave, ErrorKind::kTooLarge);
  signal(SIGXFSZ, SIG_IGN);  // a file at its limit is a full disk
  palpate::GiveWay();
  const palpate::ReceivedVolume volume = palpate::ReceiveVolume(stdin);
  const auto bricks = (volume.metadata.size.cast<double>() / palpate::kBrickEdge).array().ceil();
  const double count = bricks.prod();
  std::int64_t received = 0;
  palpate::LeafPtr leaf;
  const auto next = [&]() -> const palpate::Leaf& {
    if (received++ % kBricksAtOnce == 0) {
      reporter->Progress(0.5 * static_cast<double>(received) / count, "writing");
    }
    leaf = palpate::ReceiveLeaf(stdin);
    return *leaf;
  };
  const auto written = [reporter](double fraction) {
    reporter->Progress(0.5 + 0.5 * fraction, "writing");
  };
  errno = 0;
  try {
    palpate::WriteGridFile("/proc/self/fd/" + std::to_string(*options.save_descriptor),
                           volume.grid_type, next, volume.metadata, written);
  } catch (const std::ios_base::failure&) {
    throw palpate::CannotWrite(options.input, errno != 0 ? errno : EIO);
  }
}

int Run(const Options& options) {
  palpate::Reporter reporter(options.input, options.progress);
  const auto fail = [&reporter](ErrorKind kind, const std::string& message) {
    reporter.Fail(message);
    return ExitCode(kind);
  };
  try {
    options.save_descriptor ? Save(options, &reporter) : Import(options, &reporter);
    return 0;
  } catch (const palpate::Error& error) {
    return fail(error.kind(), error.what());
  } catch (const std::exception& error) {
    // TBB throws its own if there is no memory for a thread.
    if (options.save_descriptor) {
      return fail(ErrorKind::kTooLarge, kNoMemoryToSave + (" (" + std::string(error.what()) + ")"));
    }
    if (dynamic_cast<const std::bad_alloc*>(&error)) {
      return fail(ErrorKind::kTooLarge,
                  "there is not enough memory; crop the volume or raise --max-memory-mib");
    }
    return fail(ErrorKind::kInternal, std::string(error.what()) + "; please report this");
  }
}

}  // namespace

int main(int argc, char** argv) {
  arguments::Command app;
  Options options;
  DefineOptions(&app, &options);
  try {
    if (!app.parse(argc, argv)) return 0;
    if (options.output.empty() && !options.descriptor && !options.save_descriptor) {
      throw arguments::UsageError("OUTPUT is missing: name the .vdb file to write");
    }
  } catch (const arguments::UsageError& error) {
    app.explain(error);
    return palpate::kUsageExitCode;
  }
  return Run(options);
}
