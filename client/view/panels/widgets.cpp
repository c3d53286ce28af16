#include "client/view/panels/widgets.h"

#include <fmt/format.h>
#include <imgui_internal.h>

#include <algorithm>
#include <optional>

#include "client/sdk/words.h"
#include "client/view/palpated/shared_things.h"
#include "common/error/text.h"

namespace palpate::view {
namespace {

// A number that is typed.
struct Typed {
  ImGuiID id = 0;
  int frame = 0;        // last drawn
  double opened = 0.0;  // when the text field was opened
  double value = 0.0;   // of the text

  // False for a field that was hidden meanwhile.
  bool IsOf(ImGuiID field) const { return id == field && frame == ImGui::GetFrameCount() - 1; }
};

// Draws a number by `draw(double&)`, a Dear ImGui control that reports every key typed into it.
// Keeps typed text back until the user has finished it. Esc gives back the text that was there.
template <class Draw>
bool EditNumber(const char* label, double& value, const Draw& draw) {
  // One field has the keyboard. The field that had it may be drawn after the one that took it.
  static Typed typed;
  static Typed left;
  const ImGuiID id = ImGui::GetID(label);
  const Typed before = typed.IsOf(id) ? typed : left.IsOf(id) ? left : Typed{};
  const bool was_open = before.id == id && ImGui::TempInputIsActive(id);
  // The control compares its text with this number, whatever palpated has by now.
  double shown = was_open ? before.opened : value;
  draw(shown);
  if (ImGui::TempInputIsActive(id)) {
    if (typed.id != id) left = typed;
    typed = {.id = id,
             .frame = ImGui::GetFrameCount(),
             .opened = was_open ? before.opened : value,
             .value = shown};
    return false;
  }
  if (before.id == id) {
    const double finished = was_open ? shown : before.value;
    if (typed.id == id) typed = {};
    if (left.id == id) left = {};
    if (finished == before.opened) return false;
    value = finished;
    return true;
  }
  const bool changed = shown != value;
  value = shown;
  return changed;
}

void DrawName(const std::string& name, const ImVec2& inset) {
  const ImVec2 min = ImGui::GetItemRectMin();
  ImGui::GetWindowDrawList()->AddText({min.x + inset.x, min.y + inset.y},
                                      ImGui::GetColorU32(ImGuiCol_Text), name.c_str());
}

// Two people: heads and shoulders, one behind the other.
void DrawPeople(const ImVec2& at, float size, ImU32 color) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const auto one = [&](float x, float grow) {
    const float head = 0.17f * size * grow;
    const float y = at.y + 0.5f * size;
    list.AddCircleFilled({x, y - 0.20f * size * grow}, head, color, 12);
    // Half a disc, flat below.
    list.PathArcTo({x, y + 0.38f * size * grow}, 0.30f * size * grow, 3.14159f, 6.28319f, 12);
    list.PathFillConvex(color);
  };
  one(at.x + 0.72f * size, 0.85f);
  one(at.x + 0.30f * size, 1.0f);
}

}  // namespace

void BeginPanel(const char* name, const Area& area, ImGuiWindowFlags more) {
  ImGui::SetNextWindowPos(area.min);
  ImGui::SetNextWindowSize(area.size);
  ImGui::Begin(name, nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoBringToFrontOnFocus |
                   ImGuiWindowFlags_NoBackground | more);
}

bool ToggleButton(const char* label, bool on) {
  ImGui::PushStyleColor(ImGuiCol_Button,
                        ImGui::GetStyleColorVec4(on ? ImGuiCol_ButtonActive : ImGuiCol_FrameBg));
  const bool pressed = ImGui::Button(label);
  ImGui::PopStyleColor();
  return pressed;
}

bool DragDouble(const char* label, double& value, double speed, double least, double most,
                const char* format) {
  return EditNumber(label, value, [&](double& shown) {
    ImGui::DragScalar(label, ImGuiDataType_Double, &shown, static_cast<float>(speed), &least, &most,
                      format, ImGuiSliderFlags_AlwaysClamp);
  });
}

bool SliderDouble(const char* label, double& value, double least, double most, const char* format) {
  return ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &least, &most, format);
}

void WrappedText(const ImVec4& color, std::string_view text) {
  ImGui::PushStyleColor(ImGuiCol_Text, color);
  ImGui::TextWrapped("%s", OneLine(text).c_str());
  ImGui::PopStyleColor();
}

float ButtonWidth(const char* label) {
  return ImGui::CalcTextSize(label).x + 2.0f * ImGui::GetStyle().FramePadding.x;
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

bool NameButton(const std::string& name) {
  const ImVec2 inset = ImGui::GetStyle().FramePadding;
  const float width = ImGui::CalcTextSize(name.c_str()).x + 2.0f * inset.x;
  const bool pressed = ImGui::Button("###name", {width, 0.0f});
  DrawName(name, inset);
  return pressed;
}

bool NameSelectable(const std::string& name, bool selected, ImGuiSelectableFlags flags) {
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const float width = ImGui::CalcTextSize(name.c_str()).x;
  const bool pressed = ImGui::Selectable("###name", selected, flags,
                                         {std::max(width, ImGui::GetContentRegionAvail().x), 0.0f});
  const ImVec2 min = ImGui::GetItemRectMin();
  DrawName(name, {at.x - min.x, at.y - min.y});
  return pressed;
}

bool UnitText(const std::string& unit, float kept_px) {
  if (unit.empty()) return true;
  const std::string line = OneLine(unit, 200);
  const float after_px = ImGui::GetItemRectMax().x - ImGui::GetWindowPos().x + 5.0f;
  const float room_px = ImGui::GetContentRegionMax().x - after_px - kept_px;
  if (ImGui::CalcTextSize(line.c_str()).x <= room_px) {
    ImGui::SameLine(0.0f, 5.0f);
    ImGui::TextUnformatted(line.c_str());
    return true;
  }
  WrappedText(kPlain, line);
  return false;
}

bool Choose(const char* label, std::size_t& place, std::span<const std::string_view> names) {
  if (!ImGui::BeginCombo(label, std::string(names[place]).c_str())) return false;
  std::optional<std::size_t> chosen;
  for (std::size_t n = 0; n < names.size(); ++n) {
    if (ImGui::Selectable(std::string(names[n]).c_str(), n == place)) chosen = n;
    if (n == place) ImGui::SetItemDefaultFocus();
  }
  ImGui::EndCombo();
  place = chosen.value_or(place);
  return chosen.has_value();
}

bool HeldSlider(Viewer& viewer, const char* label, double& value, double least, double most,
                const char* format) {
  const ImGuiID id = ImGui::GetID(label);
  value = viewer.held().Shown(id, value);
  const bool changed = EditNumber(label, value, [&](double& shown) {
    ImGui::SliderScalar(label, ImGuiDataType_Double, &shown, &least, &most, format,
                        ImGuiSliderFlags_AlwaysClamp);
  });
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

bool HeldChoice(Viewer& viewer, const char* label, double& value,
                std::span<const std::string_view> words) {
  const ImGuiID id = ImGui::GetID(label);
  auto place = static_cast<std::size_t>(viewer.held().Shown(id, value));
  const std::size_t before = place;
  const bool changed = Choose(label, place, words) && place != before;
  value = static_cast<double>(place);
  viewer.held().Update(id, value, changed, false);
  return changed;
}

std::string WhyNot(const Viewer& viewer, client::Role least) {
  if (viewer.feed().is_disconnected()) return "not connected";
  if (least == client::Role::kEditor && viewer.feed().is_replay()) {
    return "these are the replay's until it ends";
  }
  if (viewer.feed().May(least)) return {};
  return "needs the role " + std::string(NameOf(least)) + "; yours is " +
         std::string(NameOf(viewer.feed().role()));
}

void BeginAllowed(const Viewer& viewer, client::Role least) {
  const std::string why = WhyNot(viewer, least);
  if (!why.empty() && !viewer.feed().is_disconnected()) ImGui::TextColored(kDim, "%s", why.c_str());
  ImGui::BeginDisabled(!why.empty());
}

void EndAllowed() { ImGui::EndDisabled(); }

void SharedSign(Viewer& viewer, std::string_view what) {
  const std::optional<SharedThings::Change> change = viewer.feed().shared().Of(what);
  ImGui::SameLine(0.0f, 5.0f);
  const float size = ImGui::GetTextLineHeight();
  ImGui::Dummy({size, ImGui::GetFrameHeight()});
  const ImVec2 corner = ImGui::GetItemRectMin();
  const bool is_fresh = change && change->is_fresh;
  const ImU32 color = (is_fresh ? kWarning : kDim).u32();
  DrawPeople({corner.x, corner.y + ImGui::GetStyle().FramePadding.y}, size, color);
  if (is_fresh) {
    ImGui::GetWindowDrawList()->AddRect(corner, ImGui::GetItemRectMax(), color, 3.0f);
  }
  if (!ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled)) return;
  std::string tip = "for everyone who is connected";
  if (change) {
    const std::string by = change->by + (change->is_own ? " (you)" : "");
    tip += fmt::format("\n{} by {}", NameOfThing(what), ByAndAge(by, change->age_s));
  }
  ImGui::SetTooltip("%s", tip.c_str());
}

void Tip(const char* text) {
  constexpr double kRest_s = 0.5;
  // The item that the pointer rests on.
  static ImVec2 place;
  static double since_s = 0.0;
  static int frame = 0;
  if (!ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled) || ImGui::IsItemActive()) return;
  const ImVec2 min = ImGui::GetItemRectMin();
  const bool is_same = frame >= ImGui::GetFrameCount() - 1 && min.x == place.x && min.y == place.y;
  if (!is_same) since_s = ImGui::GetTime();
  place = min;
  frame = ImGui::GetFrameCount();
  if (ImGui::GetTime() - since_s >= kRest_s) ImGui::SetTooltip("%s", text);
}

}  // namespace palpate::view
