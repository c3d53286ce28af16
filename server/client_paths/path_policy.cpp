#include "server/client_paths/path_policy.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <string_view>
#include <system_error>

#include "common/error/error.h"
#include "common/files/own_files.h"
#include "server/volume/load/builtin.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// Limited, so that a message can repeat the path.
constexpr std::size_t kLongestPath = 1024;

bool IsControl(unsigned char c) { return c < 0x20 || c == 0x7f; }

fs::path ParsePath(const std::string& path) {
  PathPolicy::CheckText(path);
  if (path.empty()) Refuse("the path is empty: give an absolute one");
  if (!fs::path(path).is_absolute()) Refuse(path + ": the path must be absolute");
  return path;
}

// Follows links and ".." in the part of the path that exists; keeps the rest.
fs::path Resolve(const fs::path& path) {
  std::error_code error;
  fs::path resolved = fs::weakly_canonical(path, error);
  if (error == std::errc::permission_denied) {
    throw Error(ErrorKind::kPermissionDenied, path.string() + ": the daemon may not enter there");
  }
  if (error) Refuse(path.string() + ": " + error.message() + "; name another path");
  return resolved;
}

std::vector<fs::path> ResolveFolders(const std::vector<fs::path>& folders) {
  std::vector<fs::path> resolved;
  for (const fs::path& folder : folders) {
    std::error_code error;
    resolved.push_back(fs::canonical(ParsePath(folder.string()), error));
    if (error || !fs::is_directory(resolved.back(), error)) {
      Refuse(folder.string() + " is no folder: make it, or name another");
    }
  }
  return resolved;
}

// Compares by components, so that /data does not hold /database.
bool IsWithin(const fs::path& folder, const fs::path& path) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first ==
         folder.end();
}

void CheckWithin(const std::vector<fs::path>& folders, const fs::path& resolved,
                 const std::string& path, std::string_view verb, const char* key) {
  for (const fs::path& folder : folders) {
    if (IsWithin(folder, resolved)) return;
  }
  std::string list;
  for (const fs::path& folder : folders) {
    list += (list.empty() ? " other than below " : ", ") + folder.string();
  }
  throw Error(ErrorKind::kPermissionDenied, path + ": the daemon does not " + std::string(verb) +
                                                " files" + list + " (" + key +
                                                " of its configuration)");
}

[[noreturn]] void RefuseOwn(const std::string& path) {
  throw Error(ErrorKind::kPermissionDenied,
              path + ": this is palpated's own file, or the kernel's; name another file");
}

void CheckNotOwn(const OwnFiles& own, const fs::path& resolved, const std::string& path) {
  if (own.Hold(resolved)) RefuseOwn(path);
}

}  // namespace

fs::path CurrentFolder() {
  std::error_code error;
  fs::path folder = fs::current_path(error);
  if (error) Refuse("the current folder is gone: start palpated in another one");
  return folder;
}

PathPolicy::PathPolicy(const PathPolicyOptions& options)
    : load_folders_(ResolveFolders(options.load_folders)),
      save_folders_(ResolveFolders(options.save_folders)),
      own_files_(options.own_files) {
  for (const fs::path& folder : save_folders_) {
    if (std::find(load_folders_.begin(), load_folders_.end(), folder) == load_folders_.end())
      load_folders_.push_back(folder);
  }
}

void PathPolicy::CheckText(const std::string& path) {
  // These two messages do not repeat the path.
  if (path.size() > kLongestPath) {
    Refuse("the path is longer than " + std::to_string(kLongestPath) + " bytes");
  }
  if (std::any_of(path.begin(), path.end(), IsControl)) {
    Refuse("the path holds a NUL, a line break or another control character");
  }
}

fs::path PathPolicy::CheckLoad(const std::string& path) const {
  CheckText(path);
  if (IsBuiltin(path)) return path;
  if (!path.empty() && !fs::path(path).is_absolute()) {
    Refuse(path + ": the path must be absolute, or a builtin volume such as builtin:bumps");
  }
  const fs::path resolved = Resolve(ParsePath(path));
  CheckWithin(load_folders_, resolved, path, "load", kLoadKey);
  CheckNotOwn(own_files_, resolved, path);
  return resolved;
}

std::unique_ptr<std::istream> PathPolicy::OpenToLoad(const std::string& path) const {
  if (IsBuiltin(path)) Refuse(path + ": this is no file; name one");
  // O_NONBLOCK: does not wait for the writer of a pipe.
  const int descriptor = OpenPlain(CheckLoad(path), O_RDONLY | O_NONBLOCK);
  if (descriptor < 0) {
    const std::string why = std::generic_category().message(errno);
    if (errno == EACCES) throw Error(ErrorKind::kPermissionDenied, path + ": " + why);
    throw Error(ErrorKind::kNotFound, "cannot open " + path + ": " + why);
  }
  struct stat status {};
  const bool is_file = fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode);
  const bool is_own = own_files_.HoldOpen(descriptor);
  std::unique_ptr<std::istream> stream;
  if (is_file && !is_own) {
    stream = std::make_unique<std::ifstream>(ByDescriptor(descriptor), std::ios::binary);
  }
  close(descriptor);
  if (is_own) RefuseOwn(path);
  if (!stream || !*stream) Refuse(path + ": this is no regular file; name another");
  return stream;
}

fs::path PathPolicy::CheckSave(const std::string& path) const {
  const fs::path resolved = Resolve(ParsePath(path));
  // Checked first, so that the messages below tell nothing about other folders.
  CheckWithin(save_folders_, resolved, path, "save", kSaveKey);
  CheckNotOwn(own_files_, resolved, path);
  std::error_code error;
  if (path.ends_with('/') || !resolved.has_filename())
    Refuse(path + ": the name of a file is missing");
  if (!fs::is_directory(resolved.parent_path(), error)) {
    throw Error(ErrorKind::kNotFound, path + ": there is no such folder; make it first");
  }
  // A link to a missing file is still a link here.
  const fs::file_status status = fs::symlink_status(resolved, error);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    Refuse(path + ": this is no regular file; name another");
  }
  return resolved;
}

}  // namespace palpate
