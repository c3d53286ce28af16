#include "client/view/live/file_dialog.h"

#include <array>
#include <string_view>
#include <utility>

#include "common/error/error.h"

namespace palpate::view {
namespace {

const char* TitleOf(DialogKind kind) {
  switch (kind) {
    case DialogKind::kOpenFile:
      return "Open a volume";
    case DialogKind::kOpenFolder:
      return "Open a folder of DICOM or TIFF files";
    case DialogKind::kSave:
      return "Save the volume as .nrrd or .vdb";
  }
  return "";
}

// A name that ends with a slash is a folder to begin in, not a file to choose.
std::string StartOf(DialogKind kind, const std::filesystem::path& start) {
  std::string text = start.string();
  if (kind != DialogKind::kSave && !text.ends_with('/')) text += '/';
  return text;
}

std::vector<std::string> KdialogCommand(const DialogProgram& program, DialogKind kind,
                                        const std::filesystem::path& start) {
  const char* what = kind == DialogKind::kOpenFile     ? "--getopenfilename"
                     : kind == DialogKind::kOpenFolder ? "--getexistingdirectory"
                                                       : "--getsavefilename";
  std::vector<std::string> command{program.path, "--title", TitleOf(kind), what};
  command.push_back(start.empty() ? "." : StartOf(kind, start));
  return command;
}

std::optional<DialogProgram> InstalledProgram() {
  return FindDialogProgram(VariableOf("PATH"), VariableOf("XDG_CURRENT_DESKTOP"));
}

}  // namespace

std::optional<DialogProgram> FindDialogProgram(const std::string& path_variable,
                                               const std::string& desktop) {
  using Named = std::pair<const char*, DialogFamily>;
  std::array<Named, 3> programs = {{{"zenity", DialogFamily::kZenity},
                                    {"kdialog", DialogFamily::kKdialog},
                                    {"yad", DialogFamily::kYad}}};
  if (desktop.find("KDE") != std::string::npos) std::swap(programs[0], programs[1]);
  for (const auto& [name, family] : programs) {
    std::filesystem::path path = FindProgram(name, path_variable);
    if (!path.empty()) return DialogProgram{family, std::move(path)};
  }
  return std::nullopt;
}

std::vector<std::string> DialogCommand(const DialogProgram& program, DialogKind kind,
                                       const std::filesystem::path& start) {
  if (program.family == DialogFamily::kKdialog) return KdialogCommand(program, kind, start);
  std::vector<std::string> command{
      program.path, program.family == DialogFamily::kYad ? "--file" : "--file-selection",
      std::string("--title=") + TitleOf(kind)};
  if (kind == DialogKind::kOpenFolder) command.emplace_back("--directory");
  if (kind == DialogKind::kSave) {
    command.emplace_back("--save");
    command.emplace_back("--confirm-overwrite");
  }
  if (!start.empty()) command.push_back("--filename=" + StartOf(kind, start));
  return command;
}

std::optional<std::filesystem::path> DialogAnswer(int exit_code, const std::string& output) {
  std::string_view name = output;
  // A name may itself end with a line break: only the program's own is taken off.
  if (name.ends_with('\n')) name.remove_suffix(1);
  if (exit_code != 0 || !name.starts_with('/')) return std::nullopt;
  return std::filesystem::path(name);
}

bool FileDialog::IsInstalled() { return InstalledProgram().has_value(); }

bool FileDialog::Open(DialogKind kind, const std::filesystem::path& start) {
  if (program_) return true;
  const std::optional<DialogProgram> program = InstalledProgram();
  if (!program) return false;
  try {
    program_ = std::make_unique<ChildProgram>(DialogCommand(*program, kind, start));
  } catch (const Error&) {
    return false;
  }
  kind_ = kind;
  return true;
}

std::optional<FileDialog::Answer> FileDialog::Poll() {
  if (!program_) return std::nullopt;
  const std::optional<int> exit_code = program_->Poll();
  if (!exit_code) return std::nullopt;
  Answer answer{kind_, DialogAnswer(*exit_code, program_->output())};
  program_.reset();
  return answer;
}

}  // namespace palpate::view
