#include <array>

#include "client/view/app/overlays.h"
#include "client/view/app/theme.h"
#include "client/view/scene/orientation_cube.h"
#include "client/view/scene/value_window.h"

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
  std::vector<CubeFace> faces;
  bool of_patient;
};

std::optional<Cube> CubeOf(const Viewer& viewer, const Area& view, float scale) {
  const ViewVolume& volume = viewer.feed().volume();
  const std::optional<AffineMap> X_DW = volume.X_DW();
  if (!X_DW) return std::nullopt;
  if (std::min(view.size.x, view.size.y) < kLeastView * scale) return std::nullopt;
  const Mat3 R_VW = (viewer.state().camera.X_VD().linear * X_DW->linear).colwise().normalized();
  const float radius_px = kCubeRadius * scale;
  return Cube{.middle = {view.min.x + view.size.x - kCubeFromRight * scale - radius_px,
                         view.min.y + kCubeFromTop * scale + radius_px},
              .radius_px = radius_px,
              .faces = SeenFaces(R_VW),
              .of_patient = viewer.state().overlay.letters && IsSeenAsPatient(*volume.lattice())};
}

Eigen::Vector2d InCube(const Cube& cube, const ImVec2& at) {
  return {static_cast<double>((at.x - cube.middle.x) / cube.radius_px),
          static_cast<double>((at.y - cube.middle.y) / cube.radius_px)};
}

std::optional<SignedAxis> FaceUnderPointer(const Cube& cube) {
  return FaceAt(cube.faces, InCube(cube, ImGui::GetIO().MousePos));
}

// The frame that standard views keep upright.
Mat3 UprightOf(const ViewVolume& volume) {
  const Mat3& D_from_I = volume.X_DI()->linear;
  const Mat3& W_from_I = volume.lattice()->X_WI.linear;
  return IsSeenAsPatient(*volume.lattice()) ? UprightPatient(D_from_I, W_from_I)
                                            : UprightVolume(D_from_I, W_from_I);
}

void LookFrom(Viewer& viewer, const Vec3& direction_U) {
  const ViewVolume& volume = viewer.feed().volume();
  const SideView side = LookFromSide(direction_U, IsSeenAsPatient(*volume.lattice()));
  Camera& camera = viewer.state().camera;
  camera.SetUpright(UprightOf(volume));
  camera.Set(camera.target(), side.azimuth_deg, side.elevation_deg, camera.distance_mm());
}

}  // namespace

void LookFromKey(Viewer& viewer, int key) {
  const ViewVolume& volume = viewer.feed().volume();
  if (!volume.lattice() || !volume.X_DI()) return;
  const SignedAxis side_U = SideOfKey(key, IsSeenAsPatient(*volume.lattice()));
  LookFrom(viewer, side_U.sign * Vec3::Unit(side_U.axis));
}

void TakeCube(Viewer& viewer, const Area& view, float scale) {
  const std::optional<Cube> cube = CubeOf(viewer, view, scale);
  if (!cube || !FaceUnderPointer(*cube)) return;
  const ImVec2 before = ImGui::GetCursorScreenPos();
  ImGui::SetCursorScreenPos({cube->middle.x - cube->radius_px, cube->middle.y - cube->radius_px});
  const float edge = 2.0f * cube->radius_px;
  if (ImGui::InvisibleButton("cube", {edge, edge})) {
    const ViewVolume& volume = viewer.feed().volume();
    const SignedAxis side_W = *FaceUnderPointer(*cube);
    const Vec3 side_D = side_W.sign * volume.X_DW()->linear.col(side_W.axis);
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
  if (!cube->of_patient || IsOfPatient(*viewer.feed().volume().lattice())) return;
  const char* const text = "sides assumed (LPS)";
  const ImVec2 extent = ImGui::CalcTextSize(text);
  list.AddText({cube->middle.x + cube->radius_px - extent.x, cube->middle.y + cube->radius_px},
               kDim.u32(), text);
}

}  // namespace palpate::view
