#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>

#include "client/cli/commands.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/sdk/nrrd_file.h"
#include "client/vdb/vdb_file.h"
#include "common/error/one_line.h"
#include "common/files/new_file.h"

namespace palpate::cli {
namespace {

enum class Format { kNrrd, kVdb };

Format FormatOf(const std::string& file) {
  std::string suffix = std::filesystem::path(file).extension();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (suffix == ".nrrd") return Format::kNrrd;
  if (suffix == ".vdb") return Format::kVdb;
  Refuse(file + ": the name must end with .nrrd or .vdb, which says the format");
}

std::string Summary(const client::DownloadResult& result, const std::string& file, double took_s) {
  const VolumeLattice& lattice = *result.volume.lattice();
  return fmt::format(
      "{}: {} x {} x {} voxels of {} at volume revision {}; {:.1f} MB received in {:.2f} s\n",
      OneLine(file), lattice.size.x(), lattice.size.y(), lattice.size.z(), OneLine(lattice.source),
      result.volume.resume()->volume_revision, static_cast<double>(result.bytes_received) * 1e-6,
      took_s);
}

constexpr char kCancelled[] = "the download was cancelled; no file was written";

// Before the transfer, so that nobody waits for it in vain. The file's type is not known yet: edits
// and import may make it larger or smaller than the original's, but all of floats stay floats.
void CheckSize(const client::VolumeInfo& volume) {
  const bool has_floats = volume.original_type.starts_with("float");
  client::CheckNrrdSize(volume.size, has_floats ? LeafType::kFloat : LeafType::kUint8);
}

client::DownloadResult Fetch(client::Calls& palpated, const client::ProgressFunction& progress) {
  try {
    return palpated.DownloadVolume(progress);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kCancelled) throw;
    throw Error(ErrorKind::kCancelled, kCancelled);
  }
}

void Write(const client::VolumeMirror& copy, const client::VolumeInfo& before, Format format,
           const std::string& file, bool overwrite) {
  const auto check = [] {
    if (Interrupt::IsRaised()) throw Error(ErrorKind::kCancelled, kCancelled);
  };
  if (format == Format::kNrrd) {
    client::SaveAsNrrd(copy, file, overwrite, check);
    return;
  }
  client::VdbOrigin origin;
  // Another volume may have been loaded since.
  if (before.loaded_revision == copy.lattice()->loaded_revision) {
    origin = {before.original_type, static_cast<int>(before.frames)};
  }
  client::SaveAsVdb(copy.bricks(), *copy.lattice(), origin, file, overwrite, check);
}

// Writes the whole file, or leaves the old state.
void Download(client::Calls& palpated, const std::string& file, bool overwrite) {
  const Format format = FormatOf(file);
  // Check the path before the volume is transferred.
  CheckNewFile(file, ReplacesIf(overwrite));
  WriteOutput(WithProgress([&](const client::ProgressFunction& progress) {
    const client::VolumeInfo before = palpated.GetVolume();
    if (format == Format::kNrrd) CheckSize(before);
    const auto begin = std::chrono::steady_clock::now();
    const client::DownloadResult result = Fetch(palpated, progress);
    const std::chrono::duration<double> took_s = std::chrono::steady_clock::now() - begin;
    Write(result.volume, before, format, file, overwrite);
    return Summary(result, file, took_s.count());
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

}  // namespace palpate::cli
