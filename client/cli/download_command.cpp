#include <fmt/format.h>

#include <chrono>
#include <memory>

#include "client/cli/commands.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/sdk/nrrd_file.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

std::string Summary(const client::DownloadResult& result, const std::string& file, double took_s) {
  const VolumeLattice& lattice = *result.volume.lattice();
  return fmt::format(
      "{}: {} x {} x {} voxels of {} at volume revision {}; {:.1f} MB received in {:.2f} s\n",
      OneLine(file), lattice.size.x(), lattice.size.y(), lattice.size.z(), OneLine(lattice.source),
      result.volume.resume()->volume_revision, static_cast<double>(result.bytes_received) * 1e-6,
      took_s);
}

constexpr char kCancelled[] = "the download was cancelled; no file was written";

client::DownloadResult Fetch(client::Calls& palpated, const client::ProgressFunction& progress) {
  try {
    return palpated.DownloadVolume(progress);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kCancelled) throw;
    throw Error(ErrorKind::kCancelled, kCancelled);
  }
}

// Writes the whole file, or leaves the old state.
void Download(client::Calls& palpated, const std::string& file, bool overwrite) {
  // Check the path before the volume is transferred.
  client::CheckNrrdPath(file, overwrite);
  WriteOutput(WithProgress([&](const client::ProgressFunction& progress) {
    const auto begin = std::chrono::steady_clock::now();
    const client::DownloadResult result = Fetch(palpated, progress);
    const std::chrono::duration<double> took_s = std::chrono::steady_clock::now() - begin;
    client::SaveAsNrrd(result.volume, file, overwrite, [] {
      if (!Interrupt::IsRaised()) return;
      throw Error(ErrorKind::kCancelled, kCancelled);
    });
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
      "Copies the volume as it is now, with its edits, into a file on this machine: NRRD, float.\n"
      "A lost connection is tried again. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command, "Example: palpate download scan.nrrd");
  const auto values = std::make_shared<Values>();
  command->add_option("file", values->file, "File to write, such as scan.nrrd")
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
