// The sign behind controls of what is for everyone.
#include <fmt/format.h>

#include "client/view/app/widgets.h"
#include "client/view/live/shared_things.h"

namespace palpate::view {
namespace {

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

void SharedSign(Viewer& viewer, std::string_view what) {
  const std::optional<SharedThings::Change> change = viewer.feed().shared().Of(what);
  ImGui::SameLine(0.0f, 5.0f);
  const float size = ImGui::GetTextLineHeight();
  ImGui::Dummy({size, ImGui::GetFrameHeight()});
  const ImVec2 corner = ImGui::GetItemRectMin();
  const bool is_fresh = change && change->is_fresh;
  const ImVec4& color = is_fresh ? kWarning : kDim;
  DrawPeople({corner.x, corner.y + ImGui::GetStyle().FramePadding.y}, size,
             ImGui::ColorConvertFloat4ToU32(color));
  if (is_fresh) {
    ImGui::GetWindowDrawList()->AddRect(corner, ImGui::GetItemRectMax(),
                                        ImGui::ColorConvertFloat4ToU32(color), 3.0f);
  }
  if (!ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled)) return;
  std::string tip = "for everyone who is connected";
  if (change) {
    const std::string by = change->by + (change->is_own ? " (you)" : "");
    tip += fmt::format("\n{} by {}", NameOfThing(what), ByAndAge(by, change->age_s));
  }
  ImGui::SetTooltip("%s", tip.c_str());
}

}  // namespace palpate::view
