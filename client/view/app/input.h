// What pointer and keys do to the view.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <string>
#include <vector>

#include "client/view/app/viewer.h"

namespace palpate::view {

// A key that was pressed, by what is printed on it: "r", "f1". Not Esc, which waits for no
// frame.
struct KeyPress {
  std::string key;
  bool ctrl = false;
};

// Pictures of the window work always, all else not while something is typed.
void TakeKeys(Viewer& viewer, const std::vector<KeyPress>& keys);

// Of the view that was just laid out as Dear ImGui's current item, at `min`.
void TakePointer(Viewer& viewer, const ImVec2& min, const ImVec2& size);

void UndoEdit(Viewer& viewer);
void RedoEdit(Viewer& viewer);

}  // namespace palpate::view
