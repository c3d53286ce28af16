#include <cmath>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/readout.h"
#include "client/view/panels/overlays.h"

namespace palpate::view {
namespace {

constexpr ImU32 kMark = IM_COL32(255, 255, 255, 255);
constexpr ImU32 kRim = IM_COL32(10, 12, 14, 230);
constexpr float kLongestBar = 140.0f;

// The surface under the pointer. Asks the graphics card only if the pointer or the picture changed:
// it would have to finish the frame for each answer.
std::optional<Vec3> PointedSurface(Viewer& viewer, const Area& view) {
  PointedSurfaceState& known = viewer.state().pointed_surface;
  const Eigen::Vector2d at_px = PointerIn(view.min);
  const std::uint64_t version = viewer.renderer().surface_version();
  if (known.at_px != at_px || known.version != version) {
    known = {at_px, version, viewer.SurfaceAt(at_px, PixelsOf(view.size))};
  }
  return known.p_D;
}

// The view has the pointer.
bool IsPointedAt(const Area& view) {
  return ImGui::IsWindowHovered() &&
         ImGui::IsMouseHoveringRect(view.min, {view.min.x + view.size.x, view.min.y + view.size.y});
}

// As a picture that has the pixels of the screen.
ImageSize OnScreen(const Area& view) {
  return {static_cast<int>(view.size.x), static_cast<int>(view.size.y)};
}

void DrawViewScaleBar(const Viewer& viewer, const Area& view, float below, float scale) {
  const double mm_per_px =
      viewer.state().camera.MmPerPixel(OnScreen(view)) / DeviceMmPerMm(viewer.feed().volume());
  DrawScaleBar(FitScaleBar(mm_per_px, std::min(kLongestBar * scale, 0.3f * view.size.x)),
               {view.min.x + view.size.x - 14.0f * scale,
                view.min.y + view.size.y - below - 2.2f * ImGui::GetTextLineHeight()},
               scale);
}

void DrawDistancesInView(const Viewer& viewer, const Area& view, const AffineMap& X_DW,
                         const std::optional<Vec3>& pointed_W, float scale) {
  const Projection projection(viewer.state().camera, OnScreen(view));
  const auto on_screen = [&](const Vec3& p_W) {
    auto px = projection.PixelOf(X_DW.Apply(p_W));
    if (px) *px += Eigen::Vector2d(view.min.x, view.min.y);
    return px;
  };
  DrawMeasures(
      viewer.state().measure,
      {.on_screen = on_screen, .strength = [](const Distance&) { return 1.0; }, .scale = scale},
      pointed_W);
}

void DrawEnd(const Eigen::Vector2d& at, ImU32 color, ImU32 rim, float scale) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 p = ScreenOf(at);
  const float arm = 5.0f * scale;
  for (const auto& [thick, paint] : {std::pair{3.5f, rim}, std::pair{1.5f, color}}) {
    list.AddLine({p.x - arm, p.y}, {p.x + arm, p.y}, paint, scale * thick);
    list.AddLine({p.x, p.y - arm}, {p.x, p.y + arm}, paint, scale * thick);
  }
}

void DrawDistance(const Distance& distance, const MeasurePicture& picture) {
  const auto from = picture.on_screen(distance.from_W);
  const auto to = picture.on_screen(distance.to_W);
  const double strength = picture.strength(distance);
  if (!from || !to || strength <= 0.0) return;
  const int alpha = static_cast<int>(255.0 * strength);
  const ImU32 color = IM_COL32(255, 225, 90, alpha);
  const ImU32 rim = IM_COL32(10, 12, 14, 200 * alpha / 255);
  const float scale = picture.scale;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddLine(ScreenOf(*from), ScreenOf(*to), rim, 4.0f * scale);
  list.AddLine(ScreenOf(*from), ScreenOf(*to), color, 1.5f * scale);
  DrawEnd(*from, color, rim, scale);
  DrawEnd(*to, color, rim, scale);
  // A line that only passes through a slice must not hide it.
  if (strength < 1.0) return;
  const ImVec2 middle = ScreenOf(0.5 * (*from + *to));
  DrawLabel(list, {middle.x + 8.0f * scale, middle.y + 6.0f * scale},
            {.text = TextOf(distance), .color = color}, scale);
}

}  // namespace

ImVec2 SizeOf(const Label& label) {
  return ImGui::CalcTextSize(label.text.c_str(), nullptr, false, label.wrap_px);
}

void DrawLabel(ImDrawList& list, const ImVec2& at, const Label& label, float scale) {
  const ImVec2 size = SizeOf(label);
  const ImVec2 margin{6.0f * scale, 3.0f * scale};
  list.AddRectFilled({at.x - margin.x, at.y - margin.y},
                     {at.x + size.x + margin.x, at.y + size.y + margin.y}, label.ground,
                     3.0f * scale);
  list.AddText(ImGui::GetFont(), ImGui::GetFontSize(), at, label.color, label.text.c_str(), nullptr,
               label.wrap_px);
}

void DrawScaleBar(const ScaleBar& bar, const ImVec2& right_top, float scale) {
  if (bar.length_mm <= 0.0) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float left = right_top.x - static_cast<float>(bar.length_px);
  const std::string text = TextOf(bar);
  const ImVec2 extent = ImGui::CalcTextSize(text.c_str());
  const float y = right_top.y + extent.y + 5.0f * scale;
  const float text_x = std::min(0.5f * (left + right_top.x - extent.x), right_top.x - extent.x);
  list.AddText({text_x + 1.0f, right_top.y + 1.0f}, kRim, text.c_str());
  list.AddText({text_x, right_top.y}, kMark, text.c_str());
  const auto fill = [&](float x, float up, float width, float height) {
    list.AddRectFilled({x - scale, y - (up + 1.0f) * scale},
                       {x + width + scale, y + (height + 1.0f) * scale}, kRim);
    list.AddRectFilled({x, y - up * scale}, {x + width, y + height * scale}, kMark);
  };
  fill(left, 0.0f, right_top.x - left, 2.0f);
  for (const float x : {left, right_top.x - scale}) fill(x, 3.0f, scale, 5.0f);
}

std::string Readout(const Viewer& viewer, const Vec3& p_I, const char* between) {
  const ViewVolume& volume = viewer.feed().volume();
  const PatientFrame frame = PatientFrameOf(volume);
  return ValueText(volume.Interpolate(p_I), *volume.lattice()) + between +
         PlaceText(frame.X_PI.Apply(p_I), frame.is_known, PlaceDigitsOf(volume.lattice()->X_WI));
}

void DrawMeasures(const MeasureState& measure, const MeasurePicture& picture,
                  const std::optional<Vec3>& pointed_W) {
  for (const Distance& distance : measure.distances) DrawDistance(distance, picture);
  if (!measure.begun_W) return;
  if (pointed_W) {
    DrawDistance({*measure.begun_W, *pointed_W}, picture);
  } else if (const auto at = picture.on_screen(*measure.begun_W)) {
    if (picture.strength({*measure.begun_W, *measure.begun_W}) <= 0.0) return;
    DrawEnd(*at, IM_COL32(255, 225, 90, 255), kRim, picture.scale);
  }
}

void DrawViewMarks(Viewer& viewer, const Area& view, float below, float scale) {
  const ViewVolume& volume = viewer.feed().volume();
  const std::optional<AffineMap> X_DW = volume.X_DW();
  if (!X_DW) return;
  DrawViewScaleBar(viewer, view, below, scale);
  std::optional<Vec3> pointed_W;
  if (IsPointedAt(view)) {
    if (const auto p_D = PointedSurface(viewer, view)) {
      const Vec3 p_I = volume.X_DI()->Inverse().Apply(*p_D);
      pointed_W = volume.lattice()->X_WI.Apply(p_I);
      // Below the messages.
      DrawLabel(*ImGui::GetWindowDrawList(),
                {view.min.x + 10.0f * scale,
                 view.min.y + view.size.y - below - ImGui::GetTextLineHeight() - 4.0f * scale},
                {.text = Readout(viewer, p_I, "   ")}, scale);
    }
  }
  DrawDistancesInView(viewer, view, *X_DW,
                      viewer.state().tool == Tool::kMeasure ? pointed_W : std::nullopt, scale);
}

}  // namespace palpate::view
