#include "client/view/panels/slice_pane.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "client/view/drawing/cut_handles.h"
#include "client/view/drawing/orientation_cube.h"
#include "client/view/drawing/readout.h"
#include "client/view/drawing/slice_view.h"
#include "client/view/drawing/value_window.h"
#include "client/view/panels/overlays.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"
#include "client/view/viewer/tools.h"

namespace palpate::view {
namespace {

// Of the panes; what they show may be oblique.
constexpr std::array<const char*, 3> kPlanes = {"sagittal", "coronal", "axial"};
constexpr ImU32 kCaption = IM_COL32(255, 235, 120, 255);
constexpr double kSliceZoomPerStep = 1.2;

struct Pane {
  int world_axis;
  ImVec2 min;
  ImVec2 size;
  SliceAxes axes;
  SliceView view;
  double position_voxels;  // across
  AffineMap X_WI;
  PatientFrame frame;
  SliceSide side;

  Vec3 PointUnder(const Eigen::Vector2d& at_px) const {
    return view.PointAt(at_px, position_voxels);
  }
  SliceZoom& Zoom(ViewState& state) const {
    return state.slice_zoom[static_cast<std::size_t>(world_axis)];
  }
};

Pane PaneOf(const Viewer& viewer, int world_axis, const Area& area) {
  const ViewVolume& volume = viewer.feed().volume();
  const ViewState& state = viewer.state();
  const PatientFrame frame = PatientFrameOf(volume);
  const SliceSide side = frame.is_known ? viewer.slice_side() : SliceSide::kRadiological;
  const SliceAxes axes = SliceInVolume(world_axis, side, NearestAxes(frame.X_PI.linear));
  return {.world_axis = world_axis,
          .min = area.min,
          .size = area.size,
          .axes = axes,
          .view = SliceView(axes, volume.lattice()->size, VoxelEdges(volume.X_DI()),
                            PixelsOf(area.size),
                            state.slice_zoom[static_cast<std::size_t>(world_axis)]),
          .position_voxels = state.cross_I[axes.across.axis],
          .X_WI = volume.lattice()->X_WI,
          .frame = frame,
          .side = side};
}

// So that the picture is not stretched.
Area WithoutFractions(const Area& area) {
  return {{std::floor(area.min.x), std::floor(area.min.y)},
          {std::max(1.0f, std::floor(area.size.x)), std::max(1.0f, std::floor(area.size.y))}};
}

Eigen::Vector2d DragOfPointer() {
  const ImGuiIO& io = ImGui::GetIO();
  return {io.MouseDelta.x * io.DisplayFramebufferScale.x,
          io.MouseDelta.y * io.DisplayFramebufferScale.y};
}

// From slice to slice: towards left, posterior, superior.
void TakeWheel(Viewer& viewer, const Pane& pane) {
  const ImGuiIO& io = ImGui::GetIO();
  if (!ImGui::IsItemHovered() || io.MouseWheel == 0.0f) return;
  ViewState& state = viewer.state();
  if (io.KeyCtrl) {
    pane.Zoom(state) =
        pane.view.ZoomedAt(PointerIn(pane.min), std::pow(kSliceZoomPerStep, io.MouseWheel));
    return;
  }
  const SignedAxis& across = pane.axes.across;
  Vec3 cross_I = state.cross_I;
  cross_I[across.axis] =
      std::round(cross_I[across.axis]) + (io.MouseWheel > 0.0f ? across.sign : -across.sign);
  MoveCross(viewer, cross_I);
}

void DragWindow(Viewer& viewer, const Pane& pane) {
  SurfaceOptions& surface = viewer.state().surface;
  const Eigen::Vector2d drag_px = DragOfPointer();
  if (drag_px.isZero()) return;
  const ImageSize pixels = PixelsOf(pane.size);
  const ValueWindow window = Dragged(
      ValueWindow::Between(surface.window_min, surface.window_max), drag_px.x(), drag_px.y(),
      std::min(pixels.width, pixels.height), *viewer.feed().volume().lattice());
  surface.window_min = window.min();
  surface.window_max = window.max();
}

bool TakeMeasureInPane(Viewer& viewer, const Pane& pane) {
  return TakeMeasurePointer(
      viewer, {.picture = pane.world_axis,
               .at_px = PointerIn(pane.min),
               .clicked = ImGui::IsItemClicked(ImGuiMouseButton_Left) && !ImGui::GetIO().KeyShift,
               .held = ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left),
               .point_W = [&]() -> std::optional<Vec3> {
                 return pane.X_WI.Apply(pane.PointUnder(PointerIn(pane.min)));
               },
               .pixel_of = [&](const Vec3& p_W) -> std::optional<Eigen::Vector2d> {
                 return pane.view.PixelOf(pane.X_WI.Inverse().Apply(p_W));
               },
               // Not those that lie in other slices.
               .end_of = [&](const Vec3& p_W) -> std::optional<Eigen::Vector2d> {
                 const Vec3 p_I = pane.X_WI.Inverse().Apply(p_W);
                 const double away = p_I[pane.axes.across.axis] - pane.position_voxels;
                 if (std::abs(away) > 0.75) return std::nullopt;
                 return pane.view.PixelOf(p_I);
               }});
}

void TakeDrag(Viewer& viewer, const Pane& pane) {
  if (!ImGui::IsItemActive()) return;
  ViewState& state = viewer.state();
  const bool moves = ImGui::GetIO().KeyShift || ImGui::IsMouseDown(ImGuiMouseButton_Middle);
  if (ImGui::IsMouseDown(ImGuiMouseButton_Left) && !moves) {
    if (state.tool == Tool::kMeasure) return;
    if (ImGui::GetIO().MouseClickedLastCount[ImGuiMouseButton_Left] >= 2) {
      state.cross_I = state.cross_before_click_I;
      return;
    }
    if (ImGui::IsItemActivated()) state.cross_before_click_I = state.cross_I;
    MoveCross(viewer, pane.PointUnder(PointerIn(pane.min)));
    return;
  }
  // The motion to the place where the button was pressed is not part of the drag.
  if (ImGui::IsItemActivated()) return;
  if (moves) {
    pane.Zoom(state) = pane.view.MovedBy(DragOfPointer());
  } else {
    DragWindow(viewer, pane);
  }
}

void TakePointerInPane(Viewer& viewer, const Pane& pane) {
  ViewState& state = viewer.state();
  if (ImGui::IsItemHovered()) state.pointed_slice = pane.world_axis;
  TakeWheel(viewer, pane);
  if (TakeMeasureInPane(viewer, pane)) return;
  TakeDrag(viewer, pane);
  if (state.tool != Tool::kMeasure && ImGui::IsItemHovered() &&
      ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
    const bool fills = state.filling_slice == pane.world_axis;
    state.filling_slice = fills ? std::nullopt : std::optional(pane.world_axis);
  }
}

// At the middles of the edges: the patient's sides, or the axes of W.
void DrawLetters(const Pane& pane, float scale) {
  const float margin = 6.0f * scale;
  const SliceAxes in_world = SliceInWorld(pane.world_axis, pane.side);
  const auto draw = [&](const SignedAxis& axis_I, const SignedAxis& axis_P, float share_x,
                        float share_y) {
    const std::string side = pane.frame.is_known
                                 ? LettersOf(axis_I.sign * pane.frame.X_PI.linear.col(axis_I.axis))
                                 : FaceText(axis_P, false);
    const ImVec2 text = ImGui::CalcTextSize(side.c_str());
    DrawLabel(*ImGui::GetWindowDrawList(),
              {pane.min.x + margin + share_x * (pane.size.x - text.x - 2.0f * margin),
               pane.min.y + margin + share_y * (pane.size.y - text.y - 2.0f * margin)},
              {.text = side}, scale);
  };
  draw(pane.axes.right, in_world.right, 1.0f, 0.5f);
  draw(-pane.axes.right, -in_world.right, 0.0f, 0.5f);
  draw(pane.axes.down, in_world.down, 0.5f, 1.0f);
  draw(-pane.axes.down, -in_world.down, 0.5f, 0.0f);
}

// The plane, and where the cross-hair is across it: in the patient's frame, with a letter or a
// sign, and in voxels of the file.
void DrawCaption(const Pane& pane, const ViewState& state, float scale) {
  const SignedAxis& across = pane.axes.across;
  const AffineMap& X_PI = pane.frame.X_PI;
  const bool has_letter = pane.frame.is_known && state.overlay.letters;
  const std::string plane = pane.frame.is_known ? PlaneName(pane.world_axis, X_PI.linear)
                                                : fmt::format("across {}", "xyz"[pane.world_axis]);
  // Rounded first, so that the middle is not "A 0.0".
  const PlaceDigits digits = PlaceDigitsOf(pane.X_WI);
  const double at_mm = digits.Rounded(X_PI.Apply(state.cross_I)[pane.world_axis]);
  const char letter = LetterOf({pane.world_axis, at_mm < 0.0 ? -1 : 1});
  const int after_point = digits.after_point();
  const std::string place = has_letter
                                ? fmt::format("{} {:.{}f}", letter, std::abs(at_mm), after_point)
                                : fmt::format("{:.{}f}", at_mm, after_point);
  // In one line, off the anatomy, where that has room beside the letter.
  const auto lines = [&](const char* between) {
    return fmt::format("{}{}{} mm{}{} = {:.1f}", plane, between, place, between, "xyz"[across.axis],
                       state.cross_I[across.axis]);
  };
  const bool is_wide =
      ImGui::CalcTextSize(lines("  ").c_str()).x < 0.5f * pane.size.x - 24.0f * scale;
  const std::string text = lines(is_wide ? "  " : "\n");
  DrawLabel(*ImGui::GetWindowDrawList(), {pane.min.x + 6.0f * scale, pane.min.y + 3.0f * scale},
            {.text = text, .color = kCaption}, scale);
}

Eigen::Vector2d OnScreen(const Pane& pane, const Vec3& p_I) {
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  const Eigen::Vector2d at_px = pane.view.PixelOf(p_I);
  return {pane.min.x + at_px.x() / scale.x, pane.min.y + at_px.y() / scale.y};
}

// Distances in this slice; those that pass through it are faint, others are not shown.
void DrawDistances(const Pane& pane, const ViewState& state, float scale) {
  const AffineMap X_IW = pane.X_WI.Inverse();
  const auto away = [&](const Vec3& p_W) {
    return X_IW.Apply(p_W)[pane.axes.across.axis] - pane.position_voxels;
  };
  const auto strength = [&](const Distance& distance) {
    const double from = away(distance.from_W), to = away(distance.to_W);
    if (std::max(std::abs(from), std::abs(to)) <= 0.75) return 1.0;
    return from * to <= 0.0 || std::min(std::abs(from), std::abs(to)) <= 0.75 ? 0.35 : 0.0;
  };
  const auto on_screen = [&](const Vec3& p_W) -> std::optional<Eigen::Vector2d> {
    return OnScreen(pane, X_IW.Apply(p_W));
  };
  std::optional<Vec3> pointed_W;
  if (ImGui::IsItemHovered() && state.tool == Tool::kMeasure) {
    pointed_W = pane.X_WI.Apply(pane.PointUnder(PointerIn(pane.min)));
  }
  DrawMeasures(state.measure, {.on_screen = on_screen, .strength = strength, .scale = scale},
               pointed_W);
}

// Where the crop box and this slice meet.
void DrawCrop(const Pane& pane, const SurfaceOptions& surface, const Vec3i& size) {
  const CropBox& crop = surface.crop;
  if (crop == CropBox()) return;
  const Vec3 min_I = PointOfFractions(crop.min, size);
  const Vec3 max_I = PointOfFractions(crop.max, size);
  const int across = pane.axes.across.axis;
  if (pane.position_voxels < min_I[across] || pane.position_voxels > max_I[across]) return;
  const Eigen::Vector2d a = OnScreen(pane, min_I);
  const Eigen::Vector2d b = OnScreen(pane, max_I);
  ImGui::GetWindowDrawList()->AddRect(ScreenOf(a.cwiseMin(b)), ScreenOf(a.cwiseMax(b)),
                                      IM_COL32(120, 190, 255, 220), 0.0f, 0, 1.5f);
}

// The circle in which the slice cuts a ball around the brush's place.
void DrawBallCut(const Pane& pane, const Vec3& center_I, double radius_mm, ImU32 color) {
  const int across = pane.axes.across.axis;
  const int along = (across + 1) % 3;
  const Vec3 voxel_mm = pane.X_WI.linear.colwise().norm();
  const double aside_mm = (pane.position_voxels - center_I[across]) * voxel_mm[across];
  const double cut_mm = std::sqrt(radius_mm * radius_mm - aside_mm * aside_mm);
  if (!(cut_mm > 0.0)) return;  // also of no number
  const Eigen::Vector2d center = OnScreen(pane, center_I);
  const Vec3 edge_I = center_I + cut_mm / voxel_mm[along] * Vec3::Unit(along);
  const double radius = (OnScreen(pane, edge_I) - center).norm();
  ImGui::GetWindowDrawList()->AddCircle(ScreenOf(center), static_cast<float>(radius), color, 48,
                                        1.5f);
}

void DrawBrush(const Pane& pane, const Viewer& viewer) {
  const ViewState& state = viewer.state();
  const std::optional<AffineMap>& X_DI = viewer.feed().volume().X_DI();
  if (!state.brush_at_D || !X_DI) return;
  const Vec3 center_I = X_DI->Inverse().Apply(*state.brush_at_D);
  const BrushOptions& brush = state.brush;
  DrawBallCut(pane, center_I, brush.radius_mm, IM_COL32(170, 240, 255, 255));
  if (brush.falloff_mm <= 0.0) return;
  DrawBallCut(pane, center_I, brush.radius_mm + brush.falloff_mm, IM_COL32(170, 240, 255, 110));
}

void DrawPaneScaleBar(const Pane& pane, float scale) {
  const int axis = pane.axes.right.axis;
  const double voxel_mm = pane.X_WI.linear.col(axis).norm();
  const double px_per_voxel =
      std::abs(pane.view.px_per_voxel().x()) / ImGui::GetIO().DisplayFramebufferScale.x;
  DrawScaleBar(FitScaleBar(voxel_mm / px_per_voxel, std::min(0.3f * pane.size.x, 140.0f * scale)),
               {pane.min.x + pane.size.x - 10.0f * scale, pane.min.y + 4.0f * scale}, scale);
}

// The slice across an axis of W, in an area of its own. Requires a lattice.
void DrawSlicePane(Viewer& viewer, int world_axis, const Area& given, float scale) {
  const Area area = WithoutFractions(given);
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  BeginPanel(kPlanes[static_cast<std::size_t>(world_axis)], area,
             ImGuiWindowFlags_NoScrollWithMouse | ImGuiWindowFlags_NoNav);
  ImGui::PopStyleVar();
  ImGui::InvisibleButton("slice", area.size,
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                             ImGuiButtonFlags_MouseButtonMiddle);
  TakePointerInPane(viewer, PaneOf(viewer, world_axis, area));
  // The pointer may have moved it.
  const Pane pane = PaneOf(viewer, world_axis, area);
  const ViewState& state = viewer.state();
  const unsigned texture = viewer.Slice({.picture = world_axis,
                                         .axes = pane.axes,
                                         .position_voxels = pane.position_voxels,
                                         .size = PixelsOf(area.size),
                                         .surface = state.surface,
                                         .cross_I = state.cross_I,
                                         .zoom = pane.Zoom(viewer.state())});
  const ImVec2 max = {area.min.x + area.size.x, area.min.y + area.size.y};
  ImGui::GetWindowDrawList()->AddImage(
      reinterpret_cast<ImTextureID>(static_cast<std::uintptr_t>(texture)), area.min, max,
      {0.0f, 1.0f}, {1.0f, 0.0f});
  DrawCrop(pane, state.surface, viewer.feed().volume().lattice()->size);
  DrawDistances(pane, state, scale);
  DrawBrush(pane, viewer);
  DrawPaneScaleBar(pane, scale);
  DrawCaption(pane, state, scale);
  if (state.overlay.letters) DrawLetters(pane, scale);
  if (ImGui::IsItemHovered() && pane.view.Shows(PointerIn(pane.min))) {
    DrawLabel(*ImGui::GetWindowDrawList(),
              {area.min.x + 6.0f * scale, max.y - 2.0f * ImGui::GetTextLineHeight() - 6.0f * scale},
              {.text = Readout(viewer, pane.PointUnder(PointerIn(pane.min)), "\n")}, scale);
  }
  ImGui::End();
}

}  // namespace

void MoveCross(Viewer& viewer, const Vec3& cross_I) {
  const auto& lattice = viewer.feed().volume().lattice();
  if (!lattice) return;
  const Vec3 last_I = lattice->size.cast<double>() - Vec3::Ones();
  viewer.state().cross_I = cross_I.cwiseMax(Vec3::Zero()).cwiseMin(last_I);
  viewer.state().cross_follows_proxy = false;
}

void ZoomPointedSlice(Viewer& viewer, double factor) {
  ViewState& state = viewer.state();
  if (!state.pointed_slice || !viewer.feed().volume().lattice()) return;
  // The whole size is enough: the middle of the picture stays.
  const Area any{{0.0f, 0.0f}, {200.0f, 200.0f}};
  const Pane pane = PaneOf(viewer, *state.pointed_slice, any);
  const ImageSize pixels = PixelsOf(any.size);
  pane.Zoom(state) = pane.view.ZoomedAt({0.5 * pixels.width, 0.5 * pixels.height}, factor);
}

namespace {

// Whether the slices follow, and the window as a drag changes it.
void DrawRow(Viewer& viewer, const Area& area) {
  BeginPanel("slices", area, ImGuiWindowFlags_NoScrollWithMouse);
  ViewState& state = viewer.state();
  ImGui::SetCursorPosX(6.0f);
  ImGui::Checkbox("Follow the stylus (C)", &state.cross_follows_proxy);
  Tip("slices and cross-hair go with the stylus; otherwise they stay where they were put");
  ImGui::SameLine(0.0f, 16.0f);
  ImGui::TextColored(kDim, "(?)");
  Tip("wheel: from slice to slice\nctrl+wheel, + and -: zoom\nmiddle drag, shift + drag: move\n"
      "right drag: window (across: width, up: level)\ndouble click: as large as the view, and "
      "back");
  const ValueWindow window =
      ValueWindow::Between(state.surface.window_min, state.surface.window_max);
  const std::string text = fmt::format("level {}, width {}", WindowText(window.level, window.width),
                                       WindowText(window.width, window.width));
  const float x = area.size.x - ImGui::CalcTextSize(text.c_str()).x - 4.0f;
  ImGui::SameLine(0.0f, 16.0f);
  if (ImGui::GetCursorPosX() < x) {
    ImGui::SetCursorPosX(x);
    ImGui::TextColored(kDim, "%s", text.c_str());
  }
  ImGui::End();
}

// The colours of the values in the slices and on cut faces, with a mark at the isovalue.
void DrawColorBar(const Viewer& viewer, const Area& area, float scale) {
  BeginPanel("colour bar", area, ImGuiWindowFlags_NoInputs);
  const SurfaceOptions& surface = viewer.state().surface;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float line = ImGui::GetTextLineHeight();
  const float left = area.min.x + 4.0f * scale, right = left + 12.0f * scale;
  const float top = area.min.y + 1.5f * line, bottom = area.min.y + area.size.y - 0.7f * line;
  const std::string unit = OneLine(viewer.feed().volume().lattice()->unit, 8);
  const ImU32 color = ImGui::GetColorU32(ImGuiCol_Text);
  list.AddText({left, area.min.y}, color, unit.c_str());
  if (bottom <= top) {
    ImGui::End();
    return;
  }
  const std::vector<std::uint8_t> table = ColorTable(surface.color_map);
  constexpr int kSteps = 64;
  for (int step = 0; step < kSteps; ++step) {
    const auto entry = static_cast<std::size_t>(4 * (255 * step / (kSteps - 1)));
    const float height = (bottom - top) / kSteps;
    const float y = bottom - height * static_cast<float>(step);
    list.AddRectFilled({left, y - height}, {right, y},
                       IM_COL32(table[entry], table[entry + 1], table[entry + 2], 255));
  }
  list.AddRect({left, top}, {right, bottom}, IM_COL32(110, 115, 125, 255));
  const auto y_of = [&](double share) {
    return bottom - static_cast<float>(share) * (bottom - top);
  };
  for (const double share : {0.0, 0.5, 1.0}) {
    const double value = std::lerp(surface.window_min, surface.window_max, share);
    list.AddText({right + 3.0f * scale, y_of(share) - 0.5f * line}, color,
                 WindowText(value, surface.window_max - surface.window_min).c_str());
  }
  const double share =
      (surface.isovalue - surface.window_min) / (surface.window_max - surface.window_min);
  if (share >= 0.0 && share <= 1.0) {
    list.AddLine({left - 3.0f * scale, y_of(share)}, {right + 1.0f, y_of(share)},
                 IM_COL32(255, 158, 38, 255), 2.0f);
  }
  ImGui::End();
}

}  // namespace

void DrawSlices(Viewer& viewer, const SliceStrip& strip, const Area& view, float scale) {
  if (!viewer.feed().volume().lattice()) return;
  viewer.state().pointed_slice.reset();
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  DrawRow(viewer, strip.row);
  DrawColorBar(viewer, strip.bar, scale);
  ImGui::PopStyleVar();
  // The pictures are dark in both themes.
  const ThemeScope dark(Theme::kDark);
  for (int world_axis = 0; world_axis < 3; ++world_axis) {
    const bool fills = viewer.state().filling_slice == world_axis;
    DrawSlicePane(viewer, world_axis,
                  fills ? view : strip.slices[static_cast<std::size_t>(world_axis)], scale);
  }
}

}  // namespace palpate::view
