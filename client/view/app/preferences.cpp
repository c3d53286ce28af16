#include "client/view/app/preferences.h"

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

const Json* Find(const Json& all, const char* name) {
  const auto found = all.find(name);
  return found == all.end() ? nullptr : &*found;
}

void Take(const Json& all, const char* name, bool& value) {
  if (const Json* read = Find(all, name); read && read->is_boolean()) value = read->get<bool>();
}

void Take(const Json& all, const char* name, std::string& value) {
  if (const Json* read = Find(all, name); read && read->is_string())
    value = read->get<std::string>();
}

template <class Number>
void Take(const Json& all, const char* name, Number least, Number most, Number& value) {
  const Json* read = Find(all, name);
  if (!read || !read->is_number()) return;
  const auto number = read->get<double>();
  if (number >= static_cast<double>(least) && number <= static_cast<double>(most))
    value = static_cast<Number>(number);
}

template <class Choice, std::size_t kCount>
void Take(const Json& all, const char* name, const std::array<std::string_view, kCount>& words,
          Choice& value) {
  const Json* read = Find(all, name);
  if (!read || !read->is_string()) return;
  const auto word = std::find(words.begin(), words.end(), read->get_ref<const std::string&>());
  if (word != words.end()) value = static_cast<Choice>(word - words.begin());
}

void Take(const Json& all, const char* name, std::vector<std::string>& paths) {
  const Json* read = Find(all, name);
  if (!read || !read->is_array()) return;
  for (const Json& path : *read) {
    if (paths.size() < kMostRecentFiles && path.is_string()) {
      paths.push_back(path.get<std::string>());
    }
  }
}

template <class Choice, std::size_t kCount>
std::string WordOf(Choice value, const std::array<std::string_view, kCount>& words) {
  return std::string(words[static_cast<std::size_t>(value)]);
}

void Take(const Json& all, const char* name, std::map<std::string, std::vector<SavedView>>& value) {
  const Json* read = Find(all, name);
  if (!read || !read->is_object()) return;
  for (const auto& [source, views] : read->items()) {
    if (std::vector<SavedView> usable = ViewsOf(views.dump()); !usable.empty()) {
      value[source] = std::move(usable);
    }
  }
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
  Take(all, "theme", kThemes, read.theme);
  Take(all, "font_percent", kLeastFont_percent, kMostFont_percent, read.font_percent);
  Take(all, "left_width_px", kLeastSide_px, kMostSide_px, read.left_width_px);
  Take(all, "right_width_px", kLeastSide_px, kMostSide_px, read.right_width_px);
  Take(all, "left_shown", read.left_shown);
  Take(all, "right_shown", read.right_shown);
  Take(all, "narrow_side", kSides, read.narrow_side);
  Take(all, "four_panes", read.four_panes);
  Take(all, "tab", kTabs, read.tab);
  Take(all, "recent_files", read.recent_files);
  Take(all, "last_folder", read.last_folder);
  Take(all, "slice_side", kSliceSides, read.slice_side);
  Take(all, "saved_views", read.saved_views);
  if (const Json* plots = Find(all, "plots_shown"); plots && plots->is_boolean())
    read.plots_shown = plots->get<bool>();
  return read;
}

std::string TextOf(const Preferences& preferences) {
  Json all = {{"theme", WordOf(preferences.theme, kThemes)},
              {"font_percent", preferences.font_percent},
              {"left_width_px", preferences.left_width_px},
              {"right_width_px", preferences.right_width_px},
              {"left_shown", preferences.left_shown},
              {"right_shown", preferences.right_shown},
              {"narrow_side", WordOf(preferences.narrow_side, kSides)},
              {"four_panes", preferences.four_panes},
              {"tab", WordOf(preferences.tab, kTabs)},
              {"recent_files", preferences.recent_files},
              {"last_folder", preferences.last_folder},
              {"slice_side", WordOf(preferences.slice_side, kSliceSides)}};
  for (const auto& [source, views] : preferences.saved_views) {
    if (!views.empty()) all["saved_views"][source] = Json::parse(JsonOf(views));
  }
  if (preferences.plots_shown) all["plots_shown"] = *preferences.plots_shown;
  // Names of files in it may not be UTF-8.
  return all.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

using ViewsBySource = std::map<std::string, std::vector<SavedView>>;

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
  TakeChange(before.theme, after.theme, written.theme);
  TakeChange(before.font_percent, after.font_percent, written.font_percent);
  TakeChange(before.left_width_px, after.left_width_px, written.left_width_px);
  TakeChange(before.right_width_px, after.right_width_px, written.right_width_px);
  TakeChange(before.left_shown, after.left_shown, written.left_shown);
  TakeChange(before.right_shown, after.right_shown, written.right_shown);
  TakeChange(before.narrow_side, after.narrow_side, written.narrow_side);
  TakeChange(before.four_panes, after.four_panes, written.four_panes);
  TakeChange(before.plots_shown, after.plots_shown, written.plots_shown);
  TakeChange(before.tab, after.tab, written.tab);
  TakeChange(before.recent_files, after.recent_files, written.recent_files);
  TakeChange(before.last_folder, after.last_folder, written.last_folder);
  TakeChange(before.slice_side, after.slice_side, written.slice_side);
  TakeChange(before.saved_views, after.saved_views, written.saved_views);
  WritePreferences(written, file);
  return written;
}

}  // namespace palpate::view
