#include <fmt/core.h>

#include <memory>
#include <optional>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/edit_result.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/progress.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

void Save(client::Calls& palpated, const std::string& file, bool overwrite, bool json) {
  const std::string path = PathThere(palpated, file);
  const client::SaveResult result = WithProgress(
      [&](const auto& progress) { return palpated.SaveVolume(path, overwrite, progress); });
  if (json) {
    WriteOutput(ToText(Json{{"path", path},
                            {"volume_revision", result.volume_revision},
                            {"size_bytes", result.size_bytes}}));
    return;
  }
  WriteOutput(fmt::format("saved volume revision {} to {}, {:.1f} MiB\n", result.volume_revision,
                          OneLine(path),
                          static_cast<double>(result.size_bytes) / (1024.0 * 1024.0)));
}

}  // namespace

void AddHistory(arguments::Command& app, Invocation& invocation) {
  using Revision = std::optional<std::uint64_t>;
  const auto add = [&](const char* name, const char* about,
                       client::EditResult (client::Calls::*move)(Revision)) {
    arguments::Command* command = app.add_subcommand(name, about);
    SetFooter(*command, std::string("Example: palpate ") + name);
    const auto expected_revision = std::make_shared<Revision>();
    command->add_option("--expected-revision", *expected_revision,
                        "Change it only on top of this volume revision, else exit with 7");
    AddJson(*command, invocation);
    command->callback([&invocation, expected_revision, move] {
      invocation.command = [&invocation, expected_revision, move](client::Calls& palpated) {
        PrintEdit((palpated.*move)(*expected_revision), invocation.json);
      };
    });
  };
  add("undo", "Undoes the last edit", &client::Calls::Undo);
  add("redo", "Redoes the edit that was undone last", &client::Calls::Redo);
  add("revert", "Undoes all edits since the volume was loaded; undo restores them",
      &client::Calls::Revert);
}

void AddSave(arguments::Command& app, Invocation& invocation) {
  struct Values {
    std::string path;
    bool overwrite = false;
  };
  arguments::Command* command = app.add_subcommand(
      "save",
      "Writes the volume with its edits on the daemon's machine; the file is whole or as it was\n"
      "before. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command, "Example: palpate save carved.nrrd --overwrite");
  const auto values = std::make_shared<Values>();
  command->add_option("path", values->path, "File to write; ends with .vdb or .nrrd")
      ->required()
      ->option_text("PATH");
  command->add_flag("--overwrite", values->overwrite, "Replace a file that is there");
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    invocation.command = [values, &invocation](client::Calls& palpated) {
      Save(palpated, values->path, values->overwrite, invocation.json);
    };
  });
}

}  // namespace palpate::cli
