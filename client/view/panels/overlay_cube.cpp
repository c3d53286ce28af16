// The orientation cube. Below it, if the file states no orientation: the question where the patient
// faces.
#include <array>

#include "client/view/drawing/orientation_cube.h"
#include "client/view/panels/overlays.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
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

}  // namespace palpate::view
