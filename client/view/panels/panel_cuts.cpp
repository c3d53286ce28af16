// The Cut tab: crop box and clip planes.
#include <algorithm>
#include <array>

#include "client/view/drawing/cut_handles.h"
#include "client/view/drawing/patient_axes.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

// A drag moves a face by this share of the volume.
constexpr float kSharePerPixel = 0.003f;

void EditCrop(CropBox& crop, const ViewVolume& volume) {
  const auto& [of_patient, X_PI] = PatientFrameOf(volume);
  static constexpr std::array<const char*, 3> kOfPatient = {"R to L", "A to P", "I to S"};
  static constexpr std::array<const char*, 3> kOfOthers = {"Crop x", "Crop y", "Crop z"};
  const auto rulers = RulersOf(X_PI, volume.lattice()->size);
  for (std::size_t n = 0; n < rulers.size(); ++n) {
    const CutRuler& ruler = rulers[n];
    const auto [low_mm, high_mm] = FacesOnRuler(crop, ruler);
    auto low = static_cast<float>(low_mm);
    auto high = static_cast<float>(high_mm);
    const auto begin = static_cast<float>(ruler.begin_mm);
    const auto end = static_cast<float>(ruler.end_mm);
    if (ImGui::DragFloatRange2(of_patient ? kOfPatient[n] : kOfOthers[n], &low, &high,
                               kSharePerPixel * (end - begin), begin, end, "%.1f mm", "%.1f mm",
                               ImGuiSliderFlags_AlwaysClamp)) {
      SetFacesOnRuler({static_cast<double>(low), static_cast<double>(high)}, ruler, crop);
    }
    Tip(of_patient ? "shows the volume from here to there; negative: right, anterior, inferior"
                   : "shows the volume from here to there");
  }
  if (ImGui::Button("Whole volume")) crop = {};
  Tip("ends the cropping; planes stay");
}

void Place(Viewer& viewer, std::size_t number, const Vec3& normal_I, const Vec3i& size) {
  ClipPlane& plane = viewer.state().surface.planes[number];
  plane.normal_I = normal_I.normalized();
  const auto [least, most] = OffsetRange(plane.normal_I, size);
  plane.offset_voxels = 0.5 * (least + most);
  viewer.state().cuts.pivots_I[number] = 0.5 * (size.cast<double>() - Vec3::Ones());
}

// The normal along the line of sight: the cut removes what is nearer to the viewer.
Vec3 NormalToViewer(const Viewer& viewer) {
  const Camera& camera = viewer.state().camera;
  const Vec3 normal_D = camera.Eye() - camera.target();
  const auto& X_DI = viewer.feed().volume().X_DI();
  // Normals transform as covectors.
  return X_DI ? Vec3(X_DI->linear.transpose() * normal_D) : normal_D;
}

void EditOffset(ClipPlane& plane, const VolumeLattice& lattice) {
  const auto mm = [&](double offset_voxels) {
    return DistanceOfPlane(offset_voxels, plane.normal_I, lattice.X_WI, lattice.size);
  };
  const auto [least_voxels, most_voxels] = OffsetRange(plane.normal_I, lattice.size);
  double offset_mm = mm(plane.offset_voxels);
  if (SliderDouble("Offset", offset_mm, mm(least_voxels), mm(most_voxels), "%.1f mm")) {
    plane.offset_voxels =
        std::clamp(OffsetOfPlane(offset_mm, plane.normal_I, lattice.X_WI, lattice.size),
                   least_voxels, most_voxels);
  }
  Tip("from the middle of the volume along the plane's normal");
}

void EditPlane(Viewer& viewer, std::size_t number, const VolumeLattice& lattice) {
  ClipPlane& plane = viewer.state().surface.planes[number];
  bool& placed = viewer.state().cuts.planes_placed[number];
  ImGui::PushID(static_cast<int>(number));
  const std::string label = "Plane " + std::to_string(number + 1);
  if (ImGui::Checkbox(label.c_str(), &plane.on) && plane.on && !placed) {
    Place(viewer, number, plane.normal_I, lattice.size);
    placed = true;
  }
  Tip("hides one side; drag its arrow or the rim of its disc in the view");
  if (plane.on) {
    static constexpr std::array<const char*, 3> kAxes = {"x", "y", "z"};
    for (int axis = 0; axis < 3; ++axis) {
      ImGui::SameLine();
      if (ImGui::SmallButton(kAxes[static_cast<std::size_t>(axis)])) {
        Place(viewer, number, Vec3::Unit(axis), lattice.size);
      }
      Tip("across this axis of the file");
    }
    ImGui::SameLine();
    if (ImGui::SmallButton("facing me")) {
      Place(viewer, number, NormalToViewer(viewer), lattice.size);
    }
    Tip("across the line of sight");
    ImGui::SameLine();
    if (ImGui::SmallButton("flip")) {
      plane.normal_I = -plane.normal_I;
      plane.offset_voxels = -plane.offset_voxels;
    }
    Tip("hides the other side");
    EditOffset(plane, lattice);
  }
  ImGui::PopID();
}

}  // namespace

void CutTab(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Crop and cut", ImGuiTreeNodeFlags_DefaultOpen)) return;
  const auto& lattice = viewer.feed().volume().lattice();
  if (!lattice) return;
  viewer.state().cuts.panel_frame = ImGui::GetFrameCount();
  SurfaceOptions& surface = viewer.state().surface;
  EditCrop(surface.crop, viewer.feed().volume());
  for (std::size_t n = 0; n < surface.planes.size(); ++n) EditPlane(viewer, n, *lattice);
  ImGui::Checkbox("Show values where it is cut", &surface.caps);
  Tip("the cut faces show the values in the colour map; else they are open");
}

}  // namespace palpate::view
