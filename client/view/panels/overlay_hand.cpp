#include <fmt/format.h>

#include <algorithm>

#include "client/view/drawing/readout.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

std::string Words(const HandOptions& hand, const ViewVolume& volume) {
  if (hand.way == HandWay::kPlane) return "wheel: farther, closer";
  const double press_mm = hand.press_mm / DeviceMmPerMm(volume);
  return press_mm < 0.0 ? fmt::format("wheel: {:.1f} mm above it", -press_mm)
                        : fmt::format("wheel: pressed in by {:.1f} mm", press_mm);
}

}  // namespace

float DrawHandStrip(Viewer& viewer, const Area& view, float scale) {
  if (viewer.state().tool != Tool::kHand) return 0.0f;
  HandOptions& hand = viewer.state().hand;
  // Where its lines end.
  const float most = view.size.x - 20.0f * scale - ImGui::GetStyle().WindowPadding.x;
  const auto beside_if_fits = [most](const char* label) {
    ImGui::SameLine();
    const float width = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x +
                        ImGui::CalcTextSize(label).x;
    if (ImGui::GetCursorPosX() + width > most) ImGui::NewLine();
  };
  const float bottom = view.min.y + view.size.y;
  ImGui::SetNextWindowPos({view.min.x + 10.0f * scale, bottom - 8.0f * scale}, ImGuiCond_Always,
                          {0.0f, 1.0f});
  ImGui::SetNextWindowBgAlpha(0.85f);
  ImGui::Begin("hand", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoFocusOnAppearing |
                   ImGuiWindowFlags_AlwaysAutoResize);
  ImGui::TextColored(kGood, "You hold the stylus");
  beside_if_fits("along the surface");
  if (ImGui::RadioButton("along the surface", hand.way == HandWay::kSurface))
    hand.way = HandWay::kSurface;
  Tip("The stylus touches the surface under the pointer.");
  beside_if_fits("in the view's plane");
  if (ImGui::RadioButton("in the view's plane", hand.way == HandWay::kPlane))
    hand.way = HandWay::kPlane;
  Tip("The stylus keeps its distance from you, also where it meets the surface.");
  ImGui::PushTextWrapPos(std::max(most, 1.0f));
  ImGui::TextColored(kDim, "%s   left button: deeper   right drag: turn   G: give back",
                     Words(hand, viewer.feed().volume()).c_str());
  ImGui::PopTextWrapPos();
  const float height = ImGui::GetWindowSize().y + 12.0f * scale;
  ImGui::End();
  return height;
}

}  // namespace palpate::view
