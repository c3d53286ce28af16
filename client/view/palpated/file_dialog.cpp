#include "client/view/palpated/file_dialog.h"

#include <array>
#include <string_view>
#include <utility>

#include "common/error/error.h"

namespace palpate::view {
namespace {

struct KindWords {
  const char* title;
  const char* kdialog;  // its option
};
// In the order of DialogKind.
constexpr std::array<KindWords, 4> kWords = {{
    {"Open a volume", "--getopenfilename"},
    {"Open a folder of DICOM or TIFF files", "--getexistingdirectory"},
    {"Save the volume as .nrrd or .vdb", "--getsavefilename"},
    {"Take a tool: a .toml file", "--getopenfilename"},
}};

std::filesystem::path InstalledProgram() {
  return FindDialogProgram(VariableOf("PATH"), VariableOf("XDG_CURRENT_DESKTOP"));
}

}  // namespace

std::filesystem::path FindDialogProgram(const std::string& path_variable,
                                        const std::string& desktop) {
  std::array<const char*, 3> names = {"zenity", "kdialog", "yad"};
  if (desktop.find("KDE") != std::string::npos) std::swap(names[0], names[1]);
  for (const char* name : names) {
    const std::filesystem::path program = FindProgram(name, path_variable);
    if (!program.empty()) return program;
  }
  return {};
}

std::vector<std::string> DialogCommand(const std::filesystem::path& program, DialogKind kind,
                                       const std::filesystem::path& start) {
  const KindWords& words = kWords[static_cast<std::size_t>(kind)];
  std::string from = start.string();
  // A name that ends with a slash is a folder to begin in, not a file to choose.
  if (kind != DialogKind::kSave && !from.empty() && !from.ends_with('/')) from += '/';
  const std::string name = program.filename();
  if (name == "kdialog") {
    return {program, "--title", words.title, words.kdialog, from.empty() ? "." : from};
  }
  std::vector<std::string> command{program, name == "yad" ? "--file" : "--file-selection",
                                   std::string("--title=") + words.title};
  if (kind == DialogKind::kOpenFolder) command.emplace_back("--directory");
  if (kind == DialogKind::kSave) {
    command.emplace_back("--save");
    command.emplace_back("--confirm-overwrite");
  }
  if (!from.empty()) command.push_back("--filename=" + from);
  return command;
}

std::optional<std::filesystem::path> DialogAnswer(int exit_code, const std::string& output) {
  std::string_view name = output;
  // A name may itself end with a line break: only the program's own is taken off.
  if (name.ends_with('\n')) name.remove_suffix(1);
  if (exit_code != 0 || !name.starts_with('/')) return std::nullopt;
  return std::filesystem::path(name);
}

bool FileDialog::IsInstalled() { return !InstalledProgram().empty(); }

bool FileDialog::Open(DialogKind kind, const std::filesystem::path& start) {
  if (program_) return true;
  const std::filesystem::path program = InstalledProgram();
  if (program.empty()) return false;
  try {
    program_ = std::make_unique<ChildProgram>(DialogCommand(program, kind, start));
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
