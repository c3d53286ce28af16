#include "client/view/viewer/preferences.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/files/new_file.h"

namespace palpate::view {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::uintmax_t kMostBytes = 1 << 20;
constexpr std::array<std::string_view, 2> kThemes = {"dark", "light"};
constexpr std::array<std::string_view, 4> kTabs = {"surface", "look", "cut", "edit"};
constexpr std::array<std::string_view, 2> kSides = {"left", "right"};
constexpr std::array<std::string_view, 2> kSliceSides = {"radiological", "neurological"};

fs::path FolderOf(const char* variable) {
  const char* value = std::getenv(variable);
  const fs::path folder = value ? value : "";
  return folder.is_absolute() ? folder : fs::path();
}

using ViewsBySource = std::map<std::string, std::vector<SavedView>>;

// Calls each(name, member, allowed...) for every value of the file. `allowed`: the words of a
// choice, or the least and the greatest number.
template <class Each>
void ForEachValue(const Each& each) {
  each("theme", &Preferences::theme, kThemes);
  each("font_percent", &Preferences::font_percent, kLeastFont_percent, kMostFont_percent);
  each("left_width_px", &Preferences::left_width_px, kLeastSide_px, kMostSide_px);
  each("right_width_px", &Preferences::right_width_px, kLeastSide_px, kMostSide_px);
  each("left_shown", &Preferences::left_shown);
  each("right_shown", &Preferences::right_shown);
  each("narrow_side", &Preferences::narrow_side, kSides);
  each("four_panes", &Preferences::four_panes);
  each("plots_shown", &Preferences::plots_shown);
  each("tab", &Preferences::tab, kTabs);
  each("recent_files", &Preferences::recent_files);
  each("last_folder", &Preferences::last_folder);
  each("slice_side", &Preferences::slice_side, kSliceSides);
  each("saved_views", &Preferences::saved_views);
}

// A flag or a text.
template <class Value>
void Take(const Json& read, Value& value) {
  static_assert(std::is_same_v<Value, bool> || std::is_same_v<Value, std::string>);
  if (read.type() == Json(value).type()) value = read.get<Value>();
}

void Take(const Json& read, std::optional<bool>& value) {
  if (read.is_boolean()) value = read.get<bool>();
}

template <class Number>
void Take(const Json& read, Number& value, Number least, Number most) {
  if (!read.is_number()) return;
  const auto number = read.get<double>();
  if (number >= least && number <= most) value = static_cast<Number>(number);
}

template <class Choice, std::size_t kCount>
void Take(const Json& read, Choice& value, const std::array<std::string_view, kCount>& words) {
  if (!read.is_string()) return;
  const auto word = std::find(words.begin(), words.end(), read.get_ref<const std::string&>());
  if (word != words.end()) value = static_cast<Choice>(word - words.begin());
}

void Take(const Json& read, std::vector<std::string>& paths) {
  if (!read.is_array()) return;
  for (const Json& path : read) {
    if (paths.size() < kMostRecentFiles && path.is_string()) {
      paths.push_back(path.get<std::string>());
    }
  }
}

void Take(const Json& read, ViewsBySource& value) {
  if (!read.is_object()) return;
  for (const auto& [source, views] : read.items()) {
    if (std::vector<SavedView> usable = ViewsOf(views.dump()); !usable.empty()) {
      value[source] = std::move(usable);
    }
  }
}

// ToJson returns null for what is not written.
template <class Value, class... Allowed>
Json ToJson(const Value& value, const Allowed&...) {
  return value;
}

template <class Choice, std::size_t kCount>
Json ToJson(const Choice& value, const std::array<std::string_view, kCount>& words) {
  return std::string(words[static_cast<std::size_t>(value)]);
}

Json ToJson(const std::optional<bool>& value) { return value ? Json(*value) : Json(); }

Json ToJson(const ViewsBySource& all) {
  Json written;
  for (const auto& [source, views] : all) {
    if (!views.empty()) written[source] = Json::parse(JsonOf(views));
  }
  return written;
}

Json Parse(const fs::path& file) {
  std::error_code error;
  // A pipe or a device could make the window wait for ever.
  if (!fs::is_regular_file(file, error) || fs::file_size(file, error) > kMostBytes) return {};
  std::ifstream stream(file, std::ios::binary);
  return Json::parse(stream, nullptr, false);
}

Preferences Read(const Json& all) {
  Preferences read;
  if (!all.is_object()) return read;
  ForEachValue([&](const char* name, auto member, const auto&... allowed) {
    const auto found = all.find(name);
    if (found != all.end()) Take(*found, read.*member, allowed...);
  });
  return read;
}

std::string TextOf(const Preferences& preferences) {
  Json all;
  ForEachValue([&](const char* name, auto member, const auto&... allowed) {
    const Json value = ToJson(preferences.*member, allowed...);
    if (!value.is_null()) all[name] = value;
  });
  // Names of files in it may not be UTF-8.
  return all.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::int64_t NewestOf(const std::vector<SavedView>& views) {
  std::int64_t newest_s = 0;
  for (const SavedView& view : views) newest_s = std::max(newest_s, view.saved_s);
  return newest_s;
}

void DropOldest(ViewsBySource& views) {
  views.erase(std::min_element(views.begin(), views.end(), [](const auto& a, const auto& b) {
    return NewestOf(a.second) < NewestOf(b.second);
  }));
}

template <class Value>
void TakeChange(const Value& before, const Value& after, Value& written) {
  if (after != before) written = after;
}

// Paths that are new, or have become the first.
void TakeChange(const std::vector<std::string>& before, const std::vector<std::string>& after,
                std::vector<std::string>& written) {
  for (auto path = after.rbegin(); path != after.rend(); ++path) {
    const bool is_new = std::find(before.begin(), before.end(), *path) == before.end();
    const bool is_first = path + 1 == after.rend() && (before.empty() || before.front() != *path);
    if (is_new || is_first) PutFirst(*path, written);
  }
}

void TakeChange(const ViewsBySource& before, const ViewsBySource& after, ViewsBySource& written) {
  const auto views_of = [](const ViewsBySource& all, const std::string& source) {
    const auto found = all.find(source);
    return found == all.end() ? std::vector<SavedView>() : found->second;
  };
  for (const ViewsBySource* all : {&before, &after}) {
    for (const auto& [source, views] : *all) {
      const std::vector<SavedView> now = views_of(after, source);
      if (now != views_of(before, source)) written[source] = now;
    }
  }
}

}  // namespace

void PutFirst(const std::string& path, std::vector<std::string>& files) {
  std::erase(files, path);
  files.insert(files.begin(), path);
  if (files.size() > kMostRecentFiles) files.resize(kMostRecentFiles);
}

fs::path PreferencesFile() {
  fs::path folder = FolderOf("XDG_STATE_HOME");
  if (folder.empty()) {
    folder = FolderOf("HOME");
    if (folder.empty()) return {};
    folder /= fs::path(".local") / "state";
  }
  return folder / "palpate" / "view.json";
}

Preferences ReadPreferences(const fs::path& file) { return Read(Parse(file)); }

void WritePreferences(Preferences preferences, const fs::path& file) {
  std::string text = TextOf(preferences);
  while (text.size() > kMostBytes && !preferences.saved_views.empty()) {
    DropOldest(preferences.saved_views);
    text = TextOf(preferences);
  }
  MakeFolders(file.parent_path());
  NewFile whole(file, IfThere::kReplace, 0600);
  whole.Write(text);
  // A file lost in a power failure counts as none.
  whole.TakeName(Durable::kNo);
}

Preferences WriteChanges(const Preferences& before, const Preferences& after,
                         const fs::path& file) {
  const Json there = Parse(file);
  Preferences written = there.is_object() ? Read(there) : after;
  ForEachValue([&](const char*, auto member, const auto&...) {
    TakeChange(before.*member, after.*member, written.*member);
  });
  WritePreferences(written, file);
  return written;
}

}  // namespace palpate::view
