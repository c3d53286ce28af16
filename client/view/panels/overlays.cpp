// What is drawn over the view and the slices: the orientation cube, the led hand, marks and scales.
#include "client/view/panels/overlays.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/orientation_cube.h"
#include "client/view/drawing/readout.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {

// The orientation cube. Below it, if the file states no orientation: the question where the patient
// faces.

namespace {

constexpr float kCubeRadius = 42.0f;
constexpr float kCubeFromTop = 34.0f;  // below the line of the force
constexpr float kCubeFromRight = 12.0f;
// In a smaller view there is no room for it.
constexpr float kLeastView = 5.0f * kCubeRadius;

struct Cube {
  ImVec2 middle;
  float radius_px;
  std::vector<CubeFace> faces;  // directions of P (patient_axes.h)
  bool of_patient;
};

// The linear part of the map from P to D. Call it only with a lattice and its place.
Mat3 DeviceFromPatient(const ViewVolume& volume) {
  return volume.X_DI()->linear * PatientFrameOf(volume).X_PI.linear.inverse();
}

std::optional<Cube> CubeOf(const Viewer& viewer, const Area& view, float scale) {
  const ViewVolume& volume = viewer.feed().volume();
  if (!volume.lattice() || !volume.X_DI()) return std::nullopt;
  if (std::min(view.size.x, view.size.y) < kLeastView * scale) return std::nullopt;
  const Mat3 R_VP =
      (viewer.state().camera.X_VD().linear * DeviceFromPatient(volume)).colwise().normalized();
  const float radius_px = kCubeRadius * scale;
  return Cube{.middle = {view.min.x + view.size.x - kCubeFromRight * scale - radius_px,
                         view.min.y + kCubeFromTop * scale + radius_px},
              .radius_px = radius_px,
              .faces = SeenFaces(R_VP),
              .of_patient = viewer.state().overlay.letters && PatientFrameOf(volume).is_known};
}

std::optional<SignedAxis> FaceUnderPointer(const Cube& cube) {
  const ImVec2 at = ImGui::GetIO().MousePos;
  return FaceAt(cube.faces, Eigen::Vector2d(at.x - cube.middle.x, at.y - cube.middle.y) /
                                static_cast<double>(cube.radius_px));
}

// The frame that standard views keep upright.
Mat3 UprightOf(const ViewVolume& volume) {
  const Mat3& D_from_I = volume.X_DI()->linear;
  const auto& [is_known, X_PI] = PatientFrameOf(volume);
  return is_known ? UprightPatient(D_from_I, X_PI.linear) : UprightVolume(D_from_I, X_PI.linear);
}

void LookFrom(Viewer& viewer, const Vec3& direction_U) {
  const ViewVolume& volume = viewer.feed().volume();
  const SideView side = LookFromSide(direction_U, PatientFrameOf(volume).is_known);
  Camera& camera = viewer.state().camera;
  camera.SetUpright(UprightOf(volume));
  camera.Set(camera.target(), side.azimuth_deg, side.elevation_deg, camera.distance_mm());
}

// The question below the cube; null: there is nothing to ask. Built-in shapes have no face.
const char* FacingLine(const Viewer& viewer) {
  const ViewVolume& volume = viewer.feed().volume();
  if (volume.axes_are_answered()) return "sides as answered";
  if (!volume.patient_axes().empty() || IsSample(volume.lattice()->source)) return nullptr;
  return "which way does it face?";
}

ImVec2 PlaceOfFacingLine(const Cube& cube, const char* line) {
  return {cube.middle.x + cube.radius_px - ImGui::CalcTextSize(line).x,
          cube.middle.y + cube.radius_px};
}

void ChooseDirection(const char* label, int& choice) {
  ImGui::PushID(label);
  ImGui::TextUnformatted(label);
  for (int n = 0; n < static_cast<int>(client::kWorldDirections.size()); ++n) {
    if (n > 0) ImGui::SameLine();
    ImGui::RadioButton(client::kWorldDirections[static_cast<std::size_t>(n)], &choice, n);
  }
  ImGui::PopID();
}

void FacingPopup(Viewer& viewer) {
  if (!ImGui::BeginPopup("facing")) return;
  FacingForm& form = viewer.state().facing;
  if (form.loaded_revision != viewer.feed().volume().lattice()->loaded_revision) {
    ImGui::CloseCurrentPopup();
  }
  BeginAllowed(viewer, client::Role::kEditor);
  ChooseDirection("The face points to", form.face);
  ChooseDirection("The head points to", form.head);
  ImGui::TextColored(kDim, "left and right follow if the file is not mirrored");
  const bool is_whole = form.face >= 0 && form.head >= 0 && form.face / 2 != form.head / 2;
  ImGui::BeginDisabled(!is_whole);
  if (ImGui::Button("Keep for this file")) {
    const client::PatientFacing facing{
        client::kWorldDirections[static_cast<std::size_t>(form.face)],
        client::kWorldDirections[static_cast<std::size_t>(form.head)], form.loaded_revision};
    viewer.feed().commands().Do("where it faces", [facing](client::Client& palpated) {
      palpated.Place({.facing = facing});
    });
    ImGui::CloseCurrentPopup();
  }
  ImGui::EndDisabled();
  EndAllowed();
  ImGui::EndPopup();
}

// The question where the patient faces, or that somebody has answered. A click opens the form.
void AskFacing(Viewer& viewer, const Cube& cube, float scale) {
  const char* line = FacingLine(viewer);
  if (!line) return;
  const ImVec2 extent = ImGui::CalcTextSize(line);
  const ImVec2 before = ImGui::GetCursorScreenPos();
  ImGui::SetCursorScreenPos(PlaceOfFacingLine(cube, line));
  if (ImGui::InvisibleButton("facing line", {extent.x, extent.y + 2.0f * scale})) {
    viewer.state().facing = {viewer.feed().volume().lattice()->loaded_revision};
    ImGui::OpenPopup("facing");
  }
  Tip("where face and head point, for everybody and for this file");
  FacingPopup(viewer);
  ImGui::SetCursorScreenPos(before);
}

}  // namespace

void LookFromKey(Viewer& viewer, int key) {
  const ViewVolume& volume = viewer.feed().volume();
  if (!volume.lattice() || !volume.X_DI()) return;
  const SignedAxis side_U = SideOfKey(key, PatientFrameOf(volume).is_known);
  LookFrom(viewer, side_U.sign * Vec3::Unit(side_U.axis));
}

void TakeCube(Viewer& viewer, const Area& view, float scale) {
  const std::optional<Cube> cube = CubeOf(viewer, view, scale);
  if (!cube) return;
  AskFacing(viewer, *cube, scale);
  if (!FaceUnderPointer(*cube)) return;
  const ImVec2 before = ImGui::GetCursorScreenPos();
  ImGui::SetCursorScreenPos({cube->middle.x - cube->radius_px, cube->middle.y - cube->radius_px});
  const float edge = 2.0f * cube->radius_px;
  if (ImGui::InvisibleButton("cube", {edge, edge})) {
    const ViewVolume& volume = viewer.feed().volume();
    const SignedAxis side_P = *FaceUnderPointer(*cube);
    const Vec3 side_D = side_P.sign * DeviceFromPatient(volume).col(side_P.axis);
    LookFrom(viewer, UprightOf(volume).transpose() * side_D);
  }
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("click: look from this side (keys 1 to 6)");
  ImGui::SetCursorScreenPos(before);
}

void DrawCube(const Viewer& viewer, const Area& view, float scale) {
  const std::optional<Cube> cube = CubeOf(viewer, view, scale);
  if (!cube) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const auto on_screen = [&](const Eigen::Vector2d& p) {
    return ImVec2(cube->middle.x + cube->radius_px * static_cast<float>(p.x()),
                  cube->middle.y + cube->radius_px * static_cast<float>(p.y()));
  };
  const std::optional<SignedAxis> under =
      ImGui::IsWindowHovered() ? FaceUnderPointer(*cube) : std::nullopt;
  for (const CubeFace& face : cube->faces) {
    std::array<ImVec2, 4> corners;
    for (std::size_t n = 0; n < corners.size(); ++n) corners[n] = on_screen(face.corners[n]);
    // Brighter the more it faces the viewer.
    const int gray = 60 + static_cast<int>(90.0 * face.facing);
    const bool is_under = under == face.direction_W;
    list.AddConvexPolyFilled(
        corners.data(), 4,
        is_under ? IM_COL32(60, 110, 190, 235) : IM_COL32(gray, gray + 4, gray + 14, 225));
    list.AddPolyline(corners.data(), 4, IM_COL32(20, 22, 26, 255), ImDrawFlags_Closed, 1.5f);
    const std::string text = FaceText(face.direction_W, cube->of_patient);
    const float size = ImGui::GetFontSize() * (0.7f + 0.7f * static_cast<float>(face.facing));
    const ImVec2 extent = ImGui::GetFont()->CalcTextSizeA(size, size * 10.0f, 0.0f, text.c_str());
    const ImVec2 middle = on_screen(face.middle);
    list.AddText(ImGui::GetFont(), size, {middle.x - 0.5f * extent.x, middle.y - 0.5f * extent.y},
                 IM_COL32(255, 255, 255, 255), text.c_str());
  }
  if (const char* line = FacingLine(viewer)) {
    list.AddText(PlaceOfFacingLine(*cube, line), kDim.u32(), line);
  }
}

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

namespace {

std::string WheelWords(const HandOptions& hand, bool turns, const ViewVolume& volume) {
  if (turns) return "wheel: rolls";
  if (hand.way == HandWay::kPlane) return "wheel: farther, closer";
  const double press_mm = hand.press_mm / DeviceMmPerMm(volume);
  return press_mm < 0.0 ? fmt::format("wheel: {:.1f} mm above it", -press_mm)
                        : fmt::format("wheel: pressed in by {:.1f} mm", press_mm);
}

// What the stylus's button does, for a button of the strip.
std::string ButtonWords(const Viewer& viewer, int button) {
  const auto& settings = viewer.feed().settings();
  const bool carves = button == 0 && viewer.hand().CanCarve(viewer.feed());
  const bool moves = button == 1 && settings && settings->clutch_tool;
  return fmt::format("Button {}{} ({})", button,
                     carves  ? ": carves"
                     : moves ? ": moves the volume"
                             : "",
                     button == 0 ? 'X' : 'Y');
}

// A line of the strip that breaks where there is no room.
class StripLine {
 public:
  explicit StripLine(float most) : most_(most) {}
  // Call it before each part.
  void Make(float width) {
    if (!std::exchange(is_first_, false)) ImGui::SameLine();
    if (ImGui::GetCursorPosX() + width > most_) ImGui::NewLine();
  }
  bool Radio(const char* label, bool on) {
    Make(ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x +
         ImGui::CalcTextSize(label).x);
    return ImGui::RadioButton(label, on);
  }
  bool Toggle(const char* label, bool on) {
    Make(ButtonWidth(label));
    return ToggleButton(label, on);
  }
  void Words(const std::string& text, const ImVec4& color) {
    Make(ImGui::CalcTextSize(text.c_str()).x);
    ImGui::TextColored(color, "%s", text.c_str());
  }

 private:
  float most_;
  bool is_first_ = true;
};

void StripOfPlace(HandOptions& hand, float most) {
  StripLine line(most);
  line.Words("You hold the stylus", kGood);
  if (line.Radio("along the surface", hand.way == HandWay::kSurface)) hand.way = HandWay::kSurface;
  Tip("The stylus touches the surface under the pointer.");
  if (line.Radio("in the view's plane", hand.way == HandWay::kPlane)) hand.way = HandWay::kPlane;
  Tip("The stylus keeps its distance from you, also where it meets the surface.");
}

// Each is lit while it acts.
void StripOfActs(Viewer& viewer, float most) {
  HandOptions& hand = viewer.state().hand;
  const HandTool::Acts& acts = viewer.hand().acts();
  StripLine line(most);
  for (const int button : {0, 1}) {
    const std::uint32_t bit = 1U << button;
    if (line.Toggle(ButtonWords(viewer, button).c_str(), (acts.buttons & bit) != 0))
      hand.kept_buttons ^= bit;
    Tip("holds this button of the stylus, or lets it go");
  }
  if (line.Toggle("Turn the stylus (alt)", acts.turns || hand.turns)) hand.turns = !hand.turns;
  Tip("the pointer turns the stylus, and the wheel rolls it; alt does so while it is held");
  const auto color = [](bool acts_now) -> ImVec4 { return acts_now ? kGood : kDim; };
  StripLine words(most);
  const bool carves = viewer.hand().CanCarve(viewer.feed());
  words.Words(carves ? "left button: carves" : "left button: deeper",
              color(acts.presses || (carves && (acts.buttons & 1U) != 0)));
  words.Words(WheelWords(hand, acts.turns, viewer.feed().volume()), color(acts.turns));
  words.Words("right drag: turn the view", kDim);
  words.Words("G: give back", kDim);
}

}  // namespace

float DrawHandStrip(Viewer& viewer, const Area& view, float scale) {
  if (viewer.state().tool != Tool::kHand) return 0.0f;
  // Where its lines end.
  const float most = view.size.x - 20.0f * scale - ImGui::GetStyle().WindowPadding.x;
  const float bottom = view.min.y + view.size.y;
  ImGui::SetNextWindowPos({view.min.x + 10.0f * scale, bottom - 8.0f * scale}, ImGuiCond_Always,
                          {0.0f, 1.0f});
  ImGui::SetNextWindowBgAlpha(0.85f);
  ImGui::Begin("hand", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoNav |
                   ImGuiWindowFlags_NoSavedSettings | ImGuiWindowFlags_NoFocusOnAppearing |
                   ImGuiWindowFlags_AlwaysAutoResize);
  StripOfPlace(viewer.state().hand, most);
  StripOfActs(viewer, most);
  const float height = ImGui::GetWindowSize().y + 12.0f * scale;
  ImGui::End();
  return height;
}

}  // namespace palpate::view
