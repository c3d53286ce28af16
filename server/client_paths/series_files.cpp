#include "server/client_paths/series_files.h"

#include <fnmatch.h>

#include <algorithm>
#include <system_error>

#include "common/error/error.h"
#include "server/volume/load/builtin.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

bool IsPattern(std::string_view name) { return name.find_first_of("*?") != name.npos; }

// Escapes the other special characters of fnmatch().
std::string OnlyStarsAndQuestionMarks(const std::string& name) {
  std::string pattern;
  for (const char c : name) {
    if (c == '[' || c == ']' || c == '\\') pattern += '\\';
    pattern += c;
  }
  return pattern;
}

std::vector<fs::path> Matches(const std::string& source, const PathPolicy& paths) {
  const fs::path path = source;
  if (IsPattern(path.parent_path().string())) {
    throw Error(ErrorKind::kInvalidArgument,
                source + ": only the name of a file may be a pattern, not its folder");
  }
  const fs::path folder = paths.CheckLoad(path.parent_path().string());
  const std::string pattern = OnlyStarsAndQuestionMarks(path.filename());
  std::vector<std::string> names;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename();
    if (fnmatch(pattern.c_str(), name.c_str(), FNM_PERIOD) == 0) names.push_back(name);
  }
  if (names.empty()) {
    throw Error(ErrorKind::kInvalidArgument,
                source + ": no file matches this pattern" + (error ? ": " + error.message() : ""));
  }
  std::sort(names.begin(), names.end(), ComesBefore);
  std::vector<fs::path> matches;
  for (const std::string& name : names) matches.push_back(paths.CheckLoad(folder / name));
  return matches;
}

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// Takes a number from the front, and drops its leading zeros.
std::string_view TakeNumber(std::string_view& text) {
  const auto end = std::find_if_not(text.begin(), text.end(), IsDigit);
  std::string_view number = text.substr(0, static_cast<std::size_t>(end - text.begin()));
  text.remove_prefix(number.size());
  number.remove_prefix(std::min(number.find_first_not_of('0'), number.size()));
  return number;
}

// Returns a negative number, 0 or a positive number. Names that differ only in leading zeros give
// 0.
int CompareByNumbers(std::string_view a, std::string_view b) {
  while (!a.empty() && !b.empty()) {
    if (IsDigit(a.front()) && IsDigit(b.front())) {
      const std::string_view first = TakeNumber(a);
      const std::string_view second = TakeNumber(b);
      if (first.size() != second.size()) return first.size() < second.size() ? -1 : 1;
      if (const int order = first.compare(second); order != 0) return order;
      continue;
    }
    if (a.front() != b.front()) return a.front() < b.front() ? -1 : 1;
    a.remove_prefix(1);
    b.remove_prefix(1);
  }
  return static_cast<int>(!a.empty()) - static_cast<int>(!b.empty());
}

}  // namespace

bool ComesBefore(std::string_view a, std::string_view b) {
  const int order = CompareByNumbers(a, b);
  return order != 0 ? order < 0 : a < b;
}

void CheckFrames(std::size_t frames) {
  if (frames <= kMostFrames) return;
  throw Error(ErrorKind::kTooLarge, "a series has at most " + std::to_string(kMostFrames) +
                                        " frames, not " + std::to_string(frames) +
                                        "; name fewer files, or cut the file");
}

std::vector<fs::path> FindSeriesFiles(std::span<const std::string> sources,
                                      const PathPolicy& paths) {
  std::vector<fs::path> files;
  for (const std::string& source : sources) {
    PathPolicy::CheckText(source);
    if (IsBuiltin(source)) {
      throw Error(ErrorKind::kInvalidArgument, source + ": a series is made of files");
    }
    // CheckLoad reports other errors of the path.
    const bool is_pattern = source.starts_with('/') && IsPattern(source);
    const std::vector<fs::path> found =
        is_pattern ? Matches(source, paths) : std::vector<fs::path>{paths.CheckLoad(source)};
    files.insert(files.end(), found.begin(), found.end());
    CheckFrames(files.size());
  }
  if (files.empty()) {
    throw Error(ErrorKind::kInvalidArgument, "name the files of the series, or a pattern");
  }
  return files;
}

}  // namespace palpate
