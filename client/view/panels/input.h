// The effects of pointer and keys on the view.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <string>
#include <vector>

#include "client/view/viewer/viewer.h"

namespace palpate::view {

// A pressed key, named by what is printed on it: "r", "f1". Never Esc, which does not wait for a
// frame.
struct KeyPress {
  std::string key;
  bool ctrl = false;
};

// Keys for pictures of the window always work. All others do not work while the user types text.
void TakeKeys(Viewer& viewer, const std::vector<KeyPress>& keys);

// Esc: see EscapeRule. Does not wait for a frame.
void TakeEscape(Viewer& viewer);

// Handles the pointer in the view, Dear ImGui's current item, laid out at `min`.
void TakePointer(Viewer& viewer, const ImVec2& min, const ImVec2& size);

// Undoes or redoes the user's last action, of whatever kind.
void UndoEdit(Viewer& viewer);
void RedoEdit(Viewer& viewer);

}  // namespace palpate::view
