#include <fmt/format.h>

#include <memory>
#include <string>

#include "client/cli/commands.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/files/download_file.h"
#include "common/error/one_line.h"

namespace palpate::cli {
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

}  // namespace palpate::cli
