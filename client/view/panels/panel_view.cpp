#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "client/view/panels/input.h"
#include "client/view/panels/overlays.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

enum class Shape { kBall, kCube, kOctahedron, kArrow };

// The shapes of drawing/overlay.h.
void DrawShape(Shape shape, const std::array<std::uint8_t, 4>& rgba, const ImVec2& middle,
               float radius) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImU32 color = IM_COL32(rgba[0], rgba[1], rgba[2], 255);
  const auto at = [&](float right, float down) -> ImVec2 {
    return {middle.x + right * radius, middle.y + down * radius};
  };
  switch (shape) {
    case Shape::kBall:
      list.AddCircleFilled(middle, radius, color);
      break;
    case Shape::kCube:
      list.AddRectFilled(at(-0.9f, -0.9f), at(0.9f, 0.9f), color);
      break;
    case Shape::kOctahedron:
      list.AddQuadFilled(at(0.0f, -1.25f), at(1.25f, 0.0f), at(0.0f, 1.25f), at(-1.25f, 0.0f),
                         color);
      break;
    case Shape::kArrow:
      list.AddLine(at(-1.3f, 0.0f), at(0.4f, 0.0f), color, 0.5f * radius);
      list.AddTriangleFilled(at(1.4f, 0.0f), at(0.1f, 0.8f), at(0.1f, -0.8f), color);
      break;
  }
}

struct LegendLine {
  Shape shape;
  const std::array<std::uint8_t, 4>& rgba;
  const char* text;
  const char* tip;
};

const std::array<LegendLine, 4> kLegend = {{
    {Shape::kBall, kHipColor, "stylus tip (HIP)",
     "HIP, haptic interface point: where the device says that the tip is.\n"
     "In contact it is behind the surface. Hollow: behind what is seen."},
    {Shape::kCube, kScpHColor, "proxy, on what is felt (SCP_H)",
     "SCP_H: the point on the felt surface that HIP is pulled to.\n"
     "It never enters the material. Hollow: behind what is seen."},
    {Shape::kOctahedron, kScpVColor, "proxy, on what is seen (SCP_V)",
     "SCP_V: the point next to SCP_H on the exact surface, which is drawn.\n"
     "Hollow: behind what is seen."},
    {Shape::kArrow, kForceColor, "force on the hand", "from the proxy; as long as it is strong"},
}};

void DrawLegendLine(const LegendLine& line) {
  const float height = ImGui::GetTextLineHeight();
  const ImVec2 p = ImGui::GetCursorScreenPos();
  DrawShape(line.shape, line.rgba, {p.x + 0.5f * height, p.y + 0.55f * height}, 0.33f * height);
  ImGui::Dummy({height, height});
  ImGui::SameLine();
  ImGui::Text("%s", line.text);
  Tip(line.tip);
}

void DrawLegend(const Viewer& viewer, const Area& area, float scale) {
  ImGui::SetCursorScreenPos({area.min.x + 10.0f * scale, area.min.y + 10.0f * scale});
  ImGui::BeginGroup();
  for (const LegendLine& line : kLegend) DrawLegendLine(line);
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

Label MessageOf(const std::string& text, const ThemeColor& color, float width) {
  return {.text = text, .color = color.u32(), .ground = kMessageGround.u32(), .wrap_px = width};
}

// The side that had the last click; null: none.
const Area* SideOfClick(const Layout& layout) {
  const ImVec2 click = ImGui::GetIO().MouseClickedPos[ImGuiMouseButton_Left];
  for (const Area* side : {&layout.left, &layout.right}) {
    if (side->Holds({click.x, click.y})) return side;
  }
  return nullptr;
}

// Above what is at the view's lower edge, which has the height `below`. `says_refusal`: also that
// of the last command.
void DrawMessages(const Viewer& viewer, const Area& area, bool says_refusal, float below,
                  float scale) {
  const EmergencyStop::Line stop = viewer.feed().emergency_stop().line();
  const float width = area.size.x - 40.0f * scale;
  // The bar above shows a stop that is done, as long as palpated sends poses.
  const bool says_stop = stop.is_bad || viewer.feed().silent_s();
  const std::array<Label, 4> messages = {
      MessageOf(viewer.feed().shared().FreshLine(), kWarning, width),
      MessageOf(viewer.message(), kPlain, width),
      MessageOf(says_refusal ? viewer.feed().commands().problem() : "", kWarning, width),
      MessageOf(says_stop ? stop.text : "", stop.is_bad ? kBad : kGood, width)};
  float y = area.min.y + area.size.y - below - 30.0f * scale;
  for (const Label& message : messages) {
    if (message.text.empty()) continue;
    y -= SizeOf(message).y;
    DrawLabel(*ImGui::GetWindowDrawList(), {area.min.x + 20.0f * scale, y}, message, scale);
    y -= 12.0f * scale;
  }
}

// So that nobody takes a part for the whole.
void DrawArrival(const Viewer& viewer, const Area& area, float scale) {
  const ViewVolume& volume = viewer.feed().volume();
  if (!volume.lattice() || volume.bricks_left() == 0) return;
  const auto left = static_cast<double>(viewer.feed().volume_status().bricks_left);
  const double share = 1.0 - left / static_cast<double>(volume.lattice()->Bricks());
  const std::string come =
      left > 0.0 ? fmt::format("{:.0f} % of the volume has come", std::floor(100.0 * share))
                 : std::string("the volume is coming");
  const std::string line =
      come + (volume.has_overview() ? ": the rest is coarse" : ": the rest is missing here");
  const Label label{.text = line, .color = kWarning.u32()};
  DrawLabel(*ImGui::GetWindowDrawList(),
            {area.min.x + 0.5f * (area.size.x - SizeOf(label).x), area.min.y + 40.0f * scale},
            label, scale);
}

}  // namespace

void DrawView(Viewer& viewer, const Area& area, const Layout& layout, bool has_legend,
              float scale) {
  // The picture is dark in both themes.
  const ThemeScope dark(Theme::kDark);
  const float hand = DrawHandStrip(viewer, area, scale);
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  BeginPanel("view", area, ImGuiWindowFlags_NoScrollWithMouse | ImGuiWindowFlags_NoNav);
  ImGui::PopStyleVar();
  TakeCube(viewer, area, scale);
  ImGui::InvisibleButton("picture", area.size,
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                             ImGuiButtonFlags_MouseButtonMiddle);
  TakePointer(viewer, area.min, area.size);
  viewer.Draw(PixelsOf(area.size));
  const std::uintptr_t texture = viewer.renderer().DrawnTexture();
  // OpenGL's first row is the bottom.
  ImGui::GetWindowDrawList()->AddImage(reinterpret_cast<ImTextureID>(texture), area.min,
                                       MaxOf(area), {0.0f, 1.0f}, {1.0f, 0.0f});
  DrawCube(viewer, area, scale);
  DrawViewMarks(viewer, area, hand, scale);
  if (has_legend) DrawLegend(viewer, area, scale);
  DrawMessages(viewer, area, !SideOfClick(layout), hand, scale);
  DrawArrival(viewer, area, scale);
  DrawReplayBanner(viewer, area, scale);
  ImGui::End();
}

void DrawRefusal(const Viewer& viewer, const Layout& layout, float scale) {
  const std::string problem = viewer.feed().commands().problem();
  if (problem.empty()) return;
  const Area* side = SideOfClick(layout);
  if (!side) return;
  const float margin = 12.0f * scale;
  const Label label = MessageOf(problem, kWarning, side->size.x - 2.0f * margin);
  // Below the pointer, so that the control stays visible.
  const float y = std::min(ImGui::GetIO().MouseClickedPos[ImGuiMouseButton_Left].y + 30.0f * scale,
                           side->min.y + side->size.y - margin - SizeOf(label).y);
  DrawLabel(*ImGui::GetForegroundDrawList(), {side->min.x + margin, y}, label, scale);
}

}  // namespace palpate::view
