#include <algorithm>
#include <array>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

void EditCrop(CropBox& crop) {
  static constexpr std::array<const char*, 3> names = {"Crop x", "Crop y", "Crop z"};
  for (int axis = 0; axis < 3; ++axis) {
    std::array<float, 2> percent = {static_cast<float>(100.0 * crop.min[axis]),
                                    static_cast<float>(100.0 * crop.max[axis])};
    const bool changed = ImGui::DragFloatRange2(names[static_cast<std::size_t>(axis)], &percent[0],
                                                &percent[1], 0.3f, 0.0f, 100.0f, "%.0f %%",
                                                "%.0f %%", ImGuiSliderFlags_AlwaysClamp);
    Tip("the part that is shown along this axis of the volume; what is felt stays whole");
    if (!changed) continue;
    // At least 1 % of the volume stays visible.
    crop.min[axis] = std::min(static_cast<double>(percent[0]) / 100.0, 0.99);
    crop.max[axis] = std::max(static_cast<double>(percent[1]) / 100.0, crop.min[axis] + 0.01);
  }
  if (ImGui::Button("Whole volume")) crop = {};
  Tip("show all of it again");
}

// The range of the plane's offset in voxels: the extent of the lattice, with its layer of
// background, along the plane's normal. At one end the plane cuts nothing, at the other end
// everything.
std::array<double, 2> Extent(const ClipPlane& plane, const Vec3i& size) {
  const Vec3 one = -plane.normal_I;
  const Vec3 other = plane.normal_I.cwiseProduct(size.cast<double>());
  return {one.cwiseMin(other).sum(), one.cwiseMax(other).sum()};
}

void Place(ClipPlane& plane, const Vec3& normal_I, const Vec3i& size) {
  plane.normal_I = normal_I.normalized();
  const auto [least, most] = Extent(plane, size);
  plane.offset_voxels = 0.5 * (least + most);
}

// The normal along the line of sight: the cut removes what is nearer to the viewer.
Vec3 NormalToViewer(const Viewer& viewer) {
  const Camera& camera = viewer.state().camera;
  const Vec3 normal_D = camera.Eye() - camera.target();
  const auto& X_DI = viewer.feed().volume().X_DI();
  // Normals transform as covectors.
  return X_DI ? Vec3(X_DI->linear.transpose() * normal_D) : normal_D;
}

void EditPlane(Viewer& viewer, ClipPlane& plane, int number, const Vec3i& size) {
  bool& placed = viewer.state().planes_placed[static_cast<std::size_t>(number)];
  ImGui::PushID(number);
  const std::string label = "Plane " + std::to_string(number + 1);
  if (ImGui::Checkbox(label.c_str(), &plane.on) && plane.on && !placed) {
    Place(plane, plane.normal_I, size);
    placed = true;
  }
  Tip("cut the picture at a plane; what is felt stays whole");
  if (plane.on) {
    static constexpr std::array<const char*, 3> axes = {"x", "y", "z"};
    for (int axis = 0; axis < 3; ++axis) {
      ImGui::SameLine();
      if (ImGui::SmallButton(axes[static_cast<std::size_t>(axis)])) {
        Place(plane, Vec3::Unit(axis), size);
      }
      Tip("across this axis of the volume, through its middle");
    }
    ImGui::SameLine();
    if (ImGui::SmallButton("facing me")) Place(plane, NormalToViewer(viewer), size);
    Tip("across the line of sight: removes what is nearer");
    ImGui::SameLine();
    if (ImGui::SmallButton("flip")) {
      plane.normal_I = -plane.normal_I;
      plane.offset_voxels = -plane.offset_voxels;
    }
    Tip("remove the other side");
    const auto [least, most] = Extent(plane, size);
    ImGui::SliderScalar("Offset", ImGuiDataType_Double, &plane.offset_voxels, &least, &most,
                        "%.1f voxels");
    Tip("where the plane is along its direction; ctrl+click to type");
  }
  ImGui::PopID();
}

}  // namespace

void CutsPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Crop and cut")) return;
  const auto& lattice = viewer.feed().volume().lattice();
  if (!lattice) return;
  SurfaceOptions& surface = viewer.state().surface;
  EditCrop(surface.crop);
  for (int number = 0; number < static_cast<int>(surface.planes.size()); ++number) {
    EditPlane(viewer, surface.planes[static_cast<std::size_t>(number)], number, lattice->size);
  }
  ImGui::Checkbox("Show values where it is cut", &surface.caps);
  Tip("colour the cut by the volume's values; else one looks inside");
}

}  // namespace palpate::view
