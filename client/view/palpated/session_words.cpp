#include "client/view/palpated/session_words.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <string_view>

namespace palpate::view {
namespace {

constexpr std::string_view kSuffix = ".mcap";

bool IsTaken(const std::string& name, const client::RecordingList& list) {
  const std::string path = RecordingPath(list.folder, name);
  return std::any_of(list.recordings.begin(), list.recordings.end(),
                     [&](const client::RecordedFile& file) { return file.path == path; });
}

bool IsNumber(std::string_view text) {
  constexpr std::size_t kMostDigits = 6;
  return !text.empty() && text.size() <= kMostDigits &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c); });
}

}  // namespace

std::string TimeText(std::uint64_t ticks) {
  const std::uint64_t s = ticks / 1000;
  const auto two = [](std::uint64_t value) {
    return (value < 10 ? ":0" : ":") + std::to_string(value);
  };
  if (s < 3600) return std::to_string(s / 60) + two(s % 60);
  return std::to_string(s / 3600) + two(s / 60 % 60) + two(s % 60);
}

std::string SizeText(std::uint64_t bytes) {
  std::array<char, 32> text{};
  const bool is_small = bytes < 1'000'000;
  std::snprintf(text.data(), text.size(), is_small ? "%.0f kB" : "%.1f MB",
                static_cast<double>(bytes) * (is_small ? 1e-3 : 1e-6));
  return text.data();
}

std::string RecordingPath(const std::string& folder, const std::string& name) {
  const std::string file = name.ends_with(kSuffix) ? name : name + std::string(kSuffix);
  return folder.ends_with('/') ? folder + file : folder + '/' + file;
}

std::string RecordingName(const std::string& path) {
  std::string name = path.substr(path.rfind('/') + 1);
  if (name.size() > kSuffix.size() && name.ends_with(kSuffix)) {
    name.resize(name.size() - kSuffix.size());
  }
  return name;
}

std::string NameProblem(const std::string& name, const client::RecordingList& list) {
  if (list.folder.empty()) return "palpated saves nowhere: start it with --save-folder";
  if (name.empty()) return "type a name";
  if (name.find('/') != std::string::npos) return "a name has no /";
  if (IsTaken(name, list)) return "'" + name + "' is taken";
  return {};
}

std::string FreeName(const std::string& name, const client::RecordingList& list) {
  if (!IsTaken(name, list)) return name;
  std::string stem = RecordingName(name);
  unsigned long number = 2;
  const std::size_t dash = stem.rfind('-');
  if (dash != std::string::npos && dash > 0 && IsNumber(std::string_view(stem).substr(dash + 1))) {
    number = std::stoul(stem.substr(dash + 1)) + 1;
    stem.resize(dash);
  }
  // There are at most as many names as recordings.
  for (;; ++number) {
    const std::string next = stem + '-' + std::to_string(number);
    if (!IsTaken(next, list)) return next;
  }
}

}  // namespace palpate::view
