#include "client/view/app/widgets.h"

#include "client/sdk/words.h"

#include "common/error/one_line.h"

namespace palpate::view {

void BeginPanel(const char* name, const Area& area, ImGuiWindowFlags more) {
  ImGui::SetNextWindowPos(area.min);
  ImGui::SetNextWindowSize(area.size);
  ImGui::Begin(name, nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus |
                   ImGuiWindowFlags_NoBackground | more);
}

bool DragDouble(const char* label, double& value, double speed, double least, double most,
                const char* format) {
  return ImGui::DragScalar(label, ImGuiDataType_Double, &value, static_cast<float>(speed), &least,
                           &most, format, ImGuiSliderFlags_AlwaysClamp);
}

std::string OneLine(std::string_view text, std::size_t most_bytes) {
  const bool is_cut = text.size() > most_bytes;
  if (is_cut) {
    const auto continues = [](char c) { return (static_cast<unsigned char>(c) & 0xC0) == 0x80; };
    std::size_t end = most_bytes;
    while (end > 0 && continues(text[end])) --end;
    text = text.substr(0, end);
  }
  const std::string line = palpate::OneLine(text);
  return is_cut ? line + "\xE2\x80\xA6" : line;
}

void UnitText(const std::string& unit) {
  constexpr std::size_t kLongestUnit = 12;  // bytes: "HU", "mg/cm3"
  if (unit.empty()) return;
  ImGui::SameLine(0.0f, 5.0f);
  const std::string line = OneLine(unit, kLongestUnit);
  ImGui::TextUnformatted(line.data(), line.data() + line.size());
  if (line != unit && ImGui::IsItemHovered()) {
    ImGui::SetTooltip("%s", OneLine(unit, 200).c_str());
  }
}

bool HeldSlider(Viewer& viewer, const char* label, double& value, double least, double most,
                const char* format) {
  const ImGuiID id = ImGui::GetID(label);
  value = viewer.held().Shown(id, value);
  const bool changed = ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &least, &most,
                                           format, ImGuiSliderFlags_AlwaysClamp);
  viewer.held().Update(id, value, changed, ImGui::IsItemActive());
  return changed;
}

bool HeldCheckbox(Viewer& viewer, const char* label, bool& value) {
  const ImGuiID id = ImGui::GetID(label);
  value = viewer.held().Shown(id, value ? 1.0 : 0.0) > 0.5;
  const bool changed = ImGui::Checkbox(label, &value);
  viewer.held().Update(id, value ? 1.0 : 0.0, changed, false);
  return changed;
}

bool HeldChoice(Viewer& viewer, const char* label, std::size_t& place,
                std::span<const std::string_view> words) {
  const ImGuiID id = ImGui::GetID(label);
  place = static_cast<std::size_t>(viewer.held().Shown(id, static_cast<double>(place)));
  bool changed = false;
  if (ImGui::BeginCombo(label, std::string(words[place]).c_str())) {
    for (std::size_t n = 0; n < words.size(); ++n) {
      if (!ImGui::Selectable(std::string(words[n]).c_str(), n == place)) continue;
      changed = n != place;
      place = n;
    }
    ImGui::EndCombo();
  }
  viewer.held().Update(id, static_cast<double>(place), changed, false);
  return changed;
}

void BeginAllowed(const Viewer& viewer, client::Role least) {
  const bool may = viewer.feed().May(least);
  if (!may && !viewer.feed().is_disconnected()) {
    ImGui::TextColored(kDim, "needs the role %s; yours is %s", client::NameOf(least).c_str(),
                       client::NameOf(viewer.feed().role()).c_str());
  }
  ImGui::BeginDisabled(!may);
}

void EndAllowed() { ImGui::EndDisabled(); }

bool Choose(const char* label, int& choice, const char* const* names, int count) {
  return ImGui::Combo(label, &choice, names, count);
}

ImVec4 ColorOf(const std::array<std::uint8_t, 4>& rgba) {
  return ImGui::ColorConvertU32ToFloat4(IM_COL32(rgba[0], rgba[1], rgba[2], rgba[3]));
}

}  // namespace palpate::view
