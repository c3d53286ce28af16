#include "client/cli/upload_options.h"

#include "client/cli/upload_command.h"

namespace palpate::cli {

void AddUpload(arguments::Command& app, Invocation& invocation, LoadValues& values) {
  arguments::Command* command = app.add_subcommand(
      "upload",
      "Sends a volume of this machine to the daemon, which then replaces its volume by it, or\n"
      "keeps the one before where anything fails. Any format of one file that `load` reads.\n"
      "Ctrl-C cancels, with exit code 9.");
  SetFooter(*command, "Example: palpate upload head.nii.gz --isovalue 300 --server scanner:7400");
  command->add_option("file", values.source, "File to send")->required()->option_text("FILE");
  AddVolumeOptions(*command, values);
  AddFrameOption(*command, values);
  command->callback([&invocation, &values] {
    const std::string file = values.source;
    const v1::LoadVolumeRequest options = RequestOf(values);
    invocation.command = [file, options](const Connection& c) { UploadVolume(c, file, options); };
  });
}

}  // namespace palpate::cli
