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
#include "client/view/app/viewer.h"

namespace palpate::view {

// A panel that stays where it is, on the ground that the frame was cleared to: to fill it
// again would cost more than what is in it. Always followed by ImGui::End.
void BeginPanel(const char* name, const Area& area, ImGuiWindowFlags more = 0);

bool DragDouble(const char* label, double& value, double speed, double least, double most,
                const char* format);

// Text of palpated or of a file, for one line: at most so many bytes, without what would
// begin another line. Never a format of printf, which formats of Dear ImGui are.
std::string OneLine(std::string_view text, std::size_t most_bytes);

// A unit of a volume, beside the number that was just drawn.
void UnitText(const std::string& unit);

// A setting of palpated: true where the user changed it, `value` then is the user's.
bool HeldSlider(Viewer& viewer, const char* label, double& value, double least, double most,
                const char* format);
bool HeldCheckbox(Viewer& viewer, const char* label, bool& value);
// `place` among `words`.
bool HeldChoice(Viewer& viewer, const char* label, std::size_t& place,
                std::span<const std::string_view> words);

// What follows may be used by roles from `least` on; for others it is grey, and a line says so.
// Always followed by EndAllowed.
void BeginAllowed(const Viewer& viewer, client::Role least);
void EndAllowed();

// Choice of one of `names`.
bool Choose(const char* label, int& choice, const char* const* names, int count);

ImVec4 ColorOf(const std::array<std::uint8_t, 4>& rgba);

inline const ImVec4 kPlain{1.0f, 1.0f, 1.0f, 1.0f};
inline const ImVec4 kGood{0.35f, 0.80f, 0.45f, 1.0f};
inline const ImVec4 kWarning{1.00f, 0.72f, 0.25f, 1.0f};
inline const ImVec4 kBad{0.95f, 0.33f, 0.28f, 1.0f};
inline const ImVec4 kDim{0.62f, 0.66f, 0.72f, 1.0f};

}  // namespace palpate::view
