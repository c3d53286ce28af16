#include <fmt/core.h>

#include <array>
#include <cstdint>

#include "client/view/app/input.h"
#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

ImTextureID TextureId(unsigned name) {
  return reinterpret_cast<ImTextureID>(static_cast<std::uintptr_t>(name));
}

void LegendLine(const std::array<std::uint8_t, 4>& color, const char* text, const char* tip) {
  const float height = ImGui::GetTextLineHeight();
  const ImVec2 p = ImGui::GetCursorScreenPos();
  ImGui::GetWindowDrawList()->AddCircleFilled({p.x + 0.5f * height, p.y + 0.55f * height},
                                              0.33f * height,
                                              IM_COL32(color[0], color[1], color[2], 255));
  ImGui::Dummy({height, height});
  ImGui::SameLine();
  ImGui::Text("%s", text);
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", tip);
}

void DrawLegend(const Viewer& viewer, const Area& area, float scale) {
  ImGui::SetCursorScreenPos({area.min.x + 10.0f * scale, area.min.y + 10.0f * scale});
  ImGui::BeginGroup();
  LegendLine(kHipColor, "HIP", "the stylus tip");
  LegendLine(kScpHColor, "SCP_H", "the proxy on the surface that is felt");
  LegendLine(kScpVColor, "SCP_V", "the point next to it of the surface that is seen");
  LegendLine(kForceColor, "force", "on the hand");
  ImGui::EndGroup();
  const auto& pose = viewer.feed().pose();
  // Show nothing while disconnected: old values would look like present ones.
  if (!pose || viewer.feed().connection().state != client::ConnectionState::kConnected) return;
  if (viewer.feed().silent_s()) return;
  const std::string line =
      fmt::format("{}  {:.2f} N", pose->contact ? "contact" : "no contact", pose->force_n.norm());
  const float width = ImGui::CalcTextSize(line.c_str()).x;
  ImGui::SetCursorScreenPos(
      {area.min.x + area.size.x - width - 10.0f * scale, area.min.y + 10.0f * scale});
  ImGui::TextColored(pose->contact ? kGood : kDim, "%s", line.c_str());
}

struct Message {
  std::string text;
  ImVec4 color;
};

void DrawMessages(const Viewer& viewer, const Area& area, float scale) {
  const EmergencyStop::Line stop = viewer.feed().emergency_stop().line();
  const std::array<Message, 3> messages = {
      {{viewer.message(), kPlain},
       {viewer.feed().commands().problem(), kWarning},
       // The bar above shows a stop that is done, as long as
       // palpated sends poses.
       {stop.is_bad || viewer.feed().silent_s() ? stop.text : "", stop.is_bad ? kBad : kGood}}};
  float y = area.min.y + area.size.y - 30.0f * scale;
  for (const Message& message : messages) {
    const std::string& line = message.text;
    if (line.empty()) continue;
    const float width = area.size.x - 40.0f * scale;
    const ImVec2 text = ImGui::CalcTextSize(line.c_str(), nullptr, false, width);
    const ImVec2 at{area.min.x + 20.0f * scale, y - text.y};
    ImGui::GetWindowDrawList()->AddRectFilled({at.x - 8.0f, at.y - 5.0f},
                                              {at.x + text.x + 8.0f, at.y + text.y + 5.0f},
                                              IM_COL32(15, 17, 20, 220), 4.0f);
    ImGui::SetCursorScreenPos(at);
    // Counted from the window's left border.
    ImGui::PushTextWrapPos(at.x - ImGui::GetWindowPos().x + width);
    ImGui::PushStyleColor(ImGuiCol_Text, message.color);
    ImGui::TextUnformatted(line.c_str());
    ImGui::PopStyleColor();
    ImGui::PopTextWrapPos();
    y -= text.y + 16.0f * scale;
  }
}

}  // namespace

void DrawView(Viewer& viewer, const Area& area, float scale) {
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  BeginPanel("view", area, ImGuiWindowFlags_NoScrollWithMouse | ImGuiWindowFlags_NoNav);
  ImGui::PopStyleVar();
  ImGui::InvisibleButton("picture", area.size,
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                             ImGuiButtonFlags_MouseButtonMiddle);
  TakePointer(viewer, area.min, area.size);
  viewer.Draw(PixelsOf(area.size));
  // OpenGL's first row is the bottom.
  ImGui::GetWindowDrawList()->AddImage(TextureId(viewer.renderer().DrawnTexture()), area.min,
                                       {area.min.x + area.size.x, area.min.y + area.size.y},
                                       {0.0f, 1.0f}, {1.0f, 0.0f});
  DrawLegend(viewer, area, scale);
  DrawMessages(viewer, area, scale);
  ImGui::End();
}

}  // namespace palpate::view
