// Controls that several panels have, over Dear ImGui.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "client/view/app/layout.h"
#include "client/view/app/theme.h"
#include "client/view/app/viewer.h"

namespace palpate::view {

// Begins a panel that cannot be moved. It has no background of its own: the frame was already
// cleared to that colour, and filling it again would cost more than the content. Always call
// ImGui::End afterwards.
void BeginPanel(const char* name, const Area& area, ImGuiWindowFlags more = 0);

// Text on several lines, as much as a person reads; line breaks of its own are removed.
void WrappedText(const ImVec4& color, std::string_view text);

// The width of a button with this text.
float ButtonWidth(const char* label);

// The check box with this text follows on the same line, or on a new one in a narrow side.
void SameLineIfFits(const char* label);

// Draws a number that the user drags, or types after ctrl+click. A dragged number changes at once.
// A typed number changes when the user presses Enter or leaves the field; Esc restores it. Returns
// true if the number changed.
bool DragDouble(const char* label, double& value, double speed, double least, double most,
                const char* format);

// Makes one line of at most `most_bytes` from text of palpated or of a file: removes what would
// begin another line. Do not use the result as a format: Dear ImGui's formats are printf formats.
std::string OneLine(std::string_view text, std::size_t most_bytes);

// A button or a line of a list with any text: Dear ImGui cuts its own labels at "##". The caller
// gives the identity by ImGui::PushID.
bool NameButton(const std::string& name);
bool NameSelectable(const std::string& name, bool selected = false, ImGuiSelectableFlags flags = 0);

// Draws a volume's unit beside the number just drawn, and leaves `kept_px` of the line to what
// comes after. A long unit has lines of its own below; then returns false.
bool UnitText(const std::string& unit, float kept_px = 0.0f);

// Draws a slider for a setting of palpated. Returns true if the user changed it; `value` is then
// the user's. A typed value changes as in DragDouble.
bool HeldSlider(Viewer& viewer, const char* label, double& value, double least, double most,
                const char* format);
bool HeldCheckbox(Viewer& viewer, const char* label, bool& value);
// The same for a choice: `place` is the index in `words`.
bool HeldChoice(Viewer& viewer, const char* label, std::size_t& place,
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

// Draws a choice of `names`.
bool Choose(const char* label, int& choice, const char* const* names, int count);

// The tooltip of the control that was just drawn, once the pointer has rested on it or the keyboard
// has chosen it for half a second: at once it would cover what is beside it. None while the user
// drags it.
void Tip(const char* text);

ImVec4 ColorOf(const std::array<std::uint8_t, 4>& rgba);

}  // namespace palpate::view
