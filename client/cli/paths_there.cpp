#include "client/cli/paths_there.h"

#include <filesystem>

#include "common/error/error.h"

namespace palpate::cli {

std::string PathThere(const std::string& path, bool is_here, const std::string& name) {
  if (path.empty()) throw Error(ErrorKind::kInvalidArgument, "the path is empty: name a file");
  if (std::filesystem::path(path).is_absolute()) return path;
  if (is_here) return std::filesystem::absolute(path).string();
  throw Error(ErrorKind::kInvalidArgument,
              "'" + path + "' is a relative path, and palpated at " + name +
                  " may be on another machine: give the absolute path there");
}

std::string PathThere(const client::Calls& palpated, const std::string& path) {
  return PathThere(path, palpated.shares_clock(), palpated.name());
}

std::string SourceThere(const client::Calls& palpated, const std::string& source) {
  return source.starts_with("builtin:") ? source : PathThere(palpated, source);
}

}  // namespace palpate::cli
