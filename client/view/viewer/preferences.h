// What the window remembers from one start to the next: its appearance, never what is felt.
//
// Pixels are those of a screen of about 100 pixels per inch, at a font size of 100 %.
// Threads: plain values. Pictures without a window do not read them.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/saved_view.h"

namespace palpate::view {

enum class Theme { kDark, kLight };
enum class LeftTab { kSurface, kLook, kCut, kEdit };
enum class Side { kLeft, kRight };

inline constexpr int kLeastFont_percent = 80;
inline constexpr int kMostFont_percent = 200;
inline constexpr double kLeastSide_px = 200.0;
inline constexpr double kMostSide_px = 800.0;
inline constexpr std::size_t kMostRecentFiles = 8;

struct Preferences {
  Theme theme = Theme::kDark;
  int font_percent = 100;
  double left_width_px = 300.0;
  double right_width_px = 300.0;
  bool left_shown = true;
  bool right_shown = true;
  // The side that stays where there is room for one only.
  Side narrow_side = Side::kLeft;
  bool four_panes = false;            // the view and three slices, equal
  std::optional<bool> plots_shown{};  // none: as the height of the window allows
  LeftTab tab = LeftTab::kSurface;
  // Files and folders that were opened last, newest first, as absolute paths of this machine.
  std::vector<std::string> recent_files{};
  std::string last_folder{};  // in which a dialog ended last
  SliceSide slice_side = SliceSide::kRadiological;
  std::map<std::string, std::vector<SavedView>> saved_views{};  // by the volume's source
  friend bool operator==(const Preferences&, const Preferences&) = default;
};

// Puts a path first, once. The list keeps its bound.
void PutFirst(const std::string& path, std::vector<std::string>& files);

// $XDG_STATE_HOME/palpate/view.json, else ~/.local/state/palpate/view.json; empty without a home.
std::filesystem::path PreferencesFile();

// Returns the defaults if there is no such file or it is damaged. A value that is missing or not
// possible is the default, and unknown names are ignored. Does not throw.
Preferences ReadPreferences(const std::filesystem::path& file);

// Makes the folder, too. The file is always the old or the new one. A file has a bound: above it,
// the saved views of those volumes are left out whose last view is the oldest. Throws Error:
// CannotWrite's.
void WritePreferences(Preferences preferences, const std::filesystem::path& file);

// Writes what a window has changed from `before` to `after`. The rest of the file stays, because
// another window may have changed it. A file that is missing or damaged gets all of `after`.
// Returns what was written. Throws Error: as WritePreferences.
Preferences WriteChanges(const Preferences& before, const Preferences& after,
                         const std::filesystem::path& file);

}  // namespace palpate::view
