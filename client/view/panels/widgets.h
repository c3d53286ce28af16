// Controls that several panels have, over Dear ImGui.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "client/view/viewer/layout.h"
#include "client/view/viewer/theme.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {

// A window over the panels, as large as its content.
inline constexpr ImGuiWindowFlags kDialog = ImGuiWindowFlags_NoCollapse |
                                            ImGuiWindowFlags_NoSavedSettings |
                                            ImGuiWindowFlags_AlwaysAutoResize;
// The same, but in a fixed place.
inline constexpr ImGuiWindowFlags kCard = kDialog | ImGuiWindowFlags_NoTitleBar |
                                          ImGuiWindowFlags_NoMove |
                                          ImGuiWindowFlags_NoFocusOnAppearing;

// The lower right corner.
inline ImVec2 MaxOf(const Area& area) {
  return {area.min.x + area.size.x, area.min.y + area.size.y};
}

// Begins a panel that cannot be moved. It has no background of its own: the frame was already
// cleared to that colour, and filling it again would cost more than the content. Always call
// ImGui::End afterwards.
void BeginPanel(const char* name, const Area& area, ImGuiWindowFlags more = 0);

// Text on several lines, cleaned and cut by OneLine.
void WrappedText(const ImVec4& color, std::string_view text);

// The width of a button with this text.
float ButtonWidth(const char* label);

// A button that is lit while it is on. Returns true if it was pressed.
bool ToggleButton(const char* label, bool on);

// Draws a number that the user drags, or types after ctrl+click. A dragged number changes at once.
// A typed number changes when the user presses Enter or leaves the field; Esc restores it. Returns
// true if the number changed.
bool DragDouble(const char* label, double& value, double speed, double least, double most,
                const char* format);

// Draws a slider that changes the number at once, also while it is typed.
bool SliderDouble(const char* label, double& value, double least, double most, const char* format);

// Makes one line of at most `most_bytes` from text of palpated or of a file: removes what would
// begin another line. Do not use the result as a format: Dear ImGui's formats are printf formats.
std::string OneLine(std::string_view text, std::size_t most_bytes = 300);

// A button or a line of a list with any text: Dear ImGui cuts its own labels at "##". The caller
// gives the identity by ImGui::PushID.
bool NameButton(const std::string& name);
bool NameSelectable(const std::string& name, bool selected = false, ImGuiSelectableFlags flags = 0);

// Draws a volume's unit beside the number just drawn, and leaves `kept_px` of the line to what
// comes after. A long unit has lines of its own below; then returns false.
bool UnitText(const std::string& unit, float kept_px = 0.0f);

// Draws a choice of `names`; `place` is the index in them. Returns true if the
// user chose one, also the one that it was.
bool Choose(const char* label, std::size_t& place, std::span<const std::string_view> names);
// The same for an enumeration: `names` are in its order.
template <class Enum>
bool Choose(const char* label, Enum& choice, std::span<const std::string_view> names) {
  auto place = static_cast<std::size_t>(choice);
  const bool changed = Choose(label, place, names);
  choice = static_cast<Enum>(place);
  return changed;
}

// Draws a slider for a setting of palpated. Returns true if the user changed it; `value` is then
// the user's. A typed value changes as in DragDouble.
bool HeldSlider(Viewer& viewer, const char* label, double& value, double least, double most,
                const char* format);
bool HeldCheckbox(Viewer& viewer, const char* label, bool& value);
// The same for a choice: `value` is the index in `words`.
bool HeldChoice(Viewer& viewer, const char* label, double& value,
                std::span<const std::string_view> words);

// Why nothing can be done here that needs the role `least`; empty: it can.
std::string WhyNot(const Viewer& viewer, client::Role least);

// The controls that follow are for roles from `least` on. For other roles they are grey, and a line
// says why. Always call EndAllowed afterwards.
void BeginAllowed(const Viewer& viewer, client::Role least);
void EndAllowed();

// The sign behind a control of what is for everyone; see SharedThings. Its tooltip says who changed
// it last. It is highlighted while somebody else has just changed it.
void SharedSign(Viewer& viewer, std::string_view what);

// The tooltip of the control that was just drawn, once the pointer has rested on it or the keyboard
// has chosen it for half a second: at once it would cover what is beside it. None while the user
// drags it.
void Tip(const char* text);

}  // namespace palpate::view
