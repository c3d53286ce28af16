#include "client/cli/download_options.h"

namespace palpate::cli {

void AddDownload(arguments::Command& app, Invocation& invocation, DownloadOptions& options) {
  arguments::Command* command = app.add_subcommand(
      "download",
      "Copies the volume as it is now, with its edits, into a file on this machine: NRRD, float.\n"
      "A lost connection is tried again. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command, "Example: palpate download scan.nrrd");
  command->add_option("file", options.file, "File to write, such as scan.nrrd")
      ->required()
      ->option_text("FILE");
  command->add_flag("--overwrite", options.overwrite, "Replace a file that is there");
  command->callback([&invocation, &options] {
    invocation.command = [&options](const Connection& c) { Download(c, options); };
  });
}

}  // namespace palpate::cli
