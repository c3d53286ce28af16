// The desktop's own dialog for files, as a program beside the viewer: zenity, kdialog or yad. One
// at a time; it ends with the object.
//
// Threads: one. Never waits.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/view/palpated/child_program.h"

namespace palpate::view {

enum class DialogKind { kOpenFile, kOpenFolder, kSave, kTool };

// Empty: none of the programs is installed. `path_variable`: as $PATH. `desktop`: as
// $XDG_CURRENT_DESKTOP; on KDE, kdialog comes first.
std::filesystem::path FindDialogProgram(const std::string& path_variable,
                                        const std::string& desktop);

// The command line. `start`: a folder, or for kSave a file; empty: the program's own choice.
std::vector<std::string> DialogCommand(const std::filesystem::path& program, DialogKind kind,
                                       const std::filesystem::path& start);

// The chosen path; none if the user cancelled, or the program failed.
std::optional<std::filesystem::path> DialogAnswer(int exit_code, const std::string& output);

class FileDialog {
 public:
  struct Answer {
    DialogKind kind{};
    std::optional<std::filesystem::path> path;  // none: cancelled
  };

  // False if none of the programs is installed.
  static bool IsInstalled();

  // Does nothing while a dialog is open. Returns false if it cannot be opened.
  bool Open(DialogKind kind, const std::filesystem::path& start);
  // Returns the answer once.
  std::optional<Answer> Poll();

 private:
  std::unique_ptr<ChildProgram> program_;
  DialogKind kind_{};
};

}  // namespace palpate::view
