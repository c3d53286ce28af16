#include <cmath>

#include "client/view/app/overlays.h"
#include "client/view/scene/readout.h"

namespace palpate::view {
namespace {

constexpr ImU32 kMark = IM_COL32(255, 255, 255, 255);
constexpr ImU32 kRim = IM_COL32(10, 12, 14, 230);
constexpr float kLongestBar = 140.0f;

// The surface under the pointer. Asks the graphics card only if the pointer or the picture changed:
// it would have to finish the frame for each answer.
std::optional<Vec3> PointedSurface(Viewer& viewer, const Area& view) {
  const ImVec2 at = ImGui::GetIO().MousePos;
  PointedSurfaceState& known = viewer.state().pointed_surface;
  const std::uint64_t casts = viewer.renderer().casts();
  if (known.x != at.x || known.y != at.y || known.casts != casts) {
    const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
    known = {.x = at.x,
             .y = at.y,
             .casts = casts,
             .p_D = viewer.SurfaceAt(static_cast<double>((at.x - view.min.x) * scale.x),
                                     static_cast<double>((at.y - view.min.y) * scale.y),
                                     PixelsOf(view.size))};
  }
  return known.p_D;
}

// The view has the pointer.
bool IsPointedAt(const Area& view) {
  return ImGui::IsWindowHovered() &&
         ImGui::IsMouseHoveringRect(view.min, {view.min.x + view.size.x, view.min.y + view.size.y});
}

void DrawViewScaleBar(const Viewer& viewer, const Area& view, float below, float scale) {
  const double mm_per_px = viewer.state().camera.MmPerPixel(
                               {static_cast<int>(view.size.x), static_cast<int>(view.size.y)}) /
                           DeviceMmPerMm(viewer.feed().volume());
  const double most_px = static_cast<double>(std::min(kLongestBar * scale, 0.3f * view.size.x));
  DrawScaleBar(FitScaleBar(mm_per_px, most_px),
               {view.min.x + view.size.x - 14.0f * scale,
                view.min.y + view.size.y - below - 2.2f * ImGui::GetTextLineHeight()});
}

void DrawDistancesInView(const Viewer& viewer, const Area& view, const AffineMap& X_DW,
                         const std::optional<Vec3>& pointed_W) {
  const ImageSize size{static_cast<int>(view.size.x), static_cast<int>(view.size.y)};
  const Camera& camera = viewer.state().camera;
  const auto on_screen = [&](const Vec3& p_W) -> std::optional<Eigen::Vector2d> {
    const auto px = camera.PixelOf(X_DW.Apply(p_W), size);
    if (!px) return std::nullopt;
    return Eigen::Vector2d(
        *px + Eigen::Vector2d(static_cast<double>(view.min.x), static_cast<double>(view.min.y)));
  };
  DrawMeasures(viewer.state().measure,
               {.on_screen = on_screen, .strength = [](const Distance&) { return 1.0; }},
               pointed_W);
}

ImVec2 ScreenOf(const Eigen::Vector2d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y())};
}

void DrawEnd(const Eigen::Vector2d& at, ImU32 color, ImU32 rim) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 p = ScreenOf(at);
  constexpr float kArm = 5.0f;
  for (const auto& [thick, paint] : {std::pair{3.5f, rim}, std::pair{1.5f, color}}) {
    list.AddLine({p.x - kArm, p.y}, {p.x + kArm, p.y}, paint, thick);
    list.AddLine({p.x, p.y - kArm}, {p.x, p.y + kArm}, paint, thick);
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
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddLine(ScreenOf(*from), ScreenOf(*to), rim, 4.0f);
  list.AddLine(ScreenOf(*from), ScreenOf(*to), color, 1.5f);
  DrawEnd(*from, color, rim);
  DrawEnd(*to, color, rim);
  // A line that only passes through a slice must not hide it.
  if (strength < 1.0) return;
  const ImVec2 middle = ScreenOf(0.5 * (*from + *to));
  DrawLabel({middle.x + 8.0f, middle.y + 6.0f}, TextOf(distance), color);
}

}  // namespace

void DrawLabel(const ImVec2& at, const std::string& text, ImU32 color) {
  const ImVec2 size = ImGui::CalcTextSize(text.c_str());
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled({at.x - 5.0f, at.y - 3.0f}, {at.x + size.x + 5.0f, at.y + size.y + 3.0f},
                     IM_COL32(15, 17, 20, 200));
  list.AddText(at, color, text.c_str());
}

void DrawScaleBar(const ScaleBar& bar, const ImVec2& right_top) {
  if (bar.length_mm <= 0.0) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float left = right_top.x - static_cast<float>(bar.length_px);
  const std::string text = TextOf(bar);
  const ImVec2 extent = ImGui::CalcTextSize(text.c_str());
  const float y = right_top.y + extent.y + 5.0f;
  const float text_x = std::min(0.5f * (left + right_top.x - extent.x), right_top.x - extent.x);
  list.AddText({text_x + 1.0f, right_top.y + 1.0f}, kRim, text.c_str());
  list.AddText({text_x, right_top.y}, kMark, text.c_str());
  list.AddRectFilled({left - 1.0f, y - 1.0f}, {right_top.x + 1.0f, y + 3.0f}, kRim);
  list.AddRectFilled({left, y}, {right_top.x, y + 2.0f}, kMark);
  for (const float x : {left, right_top.x - 1.0f}) {
    list.AddRectFilled({x - 1.0f, y - 4.0f}, {x + 2.0f, y + 6.0f}, kRim);
    list.AddRectFilled({x, y - 3.0f}, {x + 1.0f, y + 5.0f}, kMark);
  }
}

std::string Readout(const Viewer& viewer, const Vec3& p_I, const char* between) {
  const ViewVolume& volume = viewer.feed().volume();
  const VolumeLattice& lattice = *volume.lattice();
  return ValueText(volume.Interpolate(p_I), lattice) + between +
         PlaceText(lattice.X_WI.Apply(p_I), IsOfPatient(lattice));
}

void DrawMeasures(const MeasureState& measure, const MeasurePicture& picture,
                  const std::optional<Vec3>& pointed_W) {
  for (const Distance& distance : measure.distances) DrawDistance(distance, picture);
  if (!measure.begun_W) return;
  if (pointed_W) {
    DrawDistance({*measure.begun_W, *pointed_W}, picture);
  } else if (const auto at = picture.on_screen(*measure.begun_W)) {
    if (picture.strength({*measure.begun_W, *measure.begun_W}) <= 0.0) return;
    DrawEnd(*at, IM_COL32(255, 225, 90, 255), kRim);
  }
}

void DrawViewMarks(Viewer& viewer, const Area& view, float below, float scale) {
  const ViewVolume& volume = viewer.feed().volume();
  if (!volume.lattice() || !volume.X_DI()) return;
  DrawViewScaleBar(viewer, view, below, scale);
  const AffineMap X_DW = *volume.X_DI() * volume.lattice()->X_WI.Inverse();
  std::optional<Vec3> pointed_W;
  if (IsPointedAt(view)) {
    if (const auto p_D = PointedSurface(viewer, view)) {
      const Vec3 p_I = volume.X_DI()->Inverse().Apply(*p_D);
      pointed_W = volume.lattice()->X_WI.Apply(p_I);
      // Below the messages.
      DrawLabel({view.min.x + 10.0f * scale,
                 view.min.y + view.size.y - below - ImGui::GetTextLineHeight() - 4.0f},
                Readout(viewer, p_I, "   "), kMark);
    }
  }
  DrawDistancesInView(viewer, view, X_DW,
                      viewer.state().tool == Tool::kMeasure ? pointed_W : std::nullopt);
}

}  // namespace palpate::view
