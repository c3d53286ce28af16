#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

void EditColor(const char* label, Rgb& color) {
  ImGui::ColorEdit3(label, color.data(), ImGuiColorEditFlags_NoInputs);
}

void EditSurface(SurfaceOptions& surface) {
  ImGui::Checkbox("Surface", &surface.shown);
  Tip("show the isosurface that is felt");
  ImGui::SameLine(0.0f, 20.0f);
  EditColor("Colour", surface.color);
  Tip("of the surface, where it has one colour");
  static const char* const colorings[] = {"one colour", "by height", "by slope"};
  int coloring = static_cast<int>(surface.coloring);
  if (Choose("Colouring", coloring, colorings, 3)) {
    surface.coloring = static_cast<SurfaceColoring>(coloring);
  }
  Tip("by height: along the view's upright axis; by slope: how steep the values are");
  static const char* const maps[] = {"gray", "bone", "hot", "viridis", "cool-warm"};
  static_assert(std::size(maps) == kColorMapNames.size());
  int map = static_cast<int>(surface.color_map);
  if (Choose("Colour map", map, maps, static_cast<int>(std::size(maps)))) {
    surface.color_map = static_cast<ColorMap>(map);
  }
}

void EditVeil(Veil& veil, double min, double max) {
  ImGui::Checkbox("Veil (V)", &veil.shown);
  Tip("a second, translucent isosurface");
  if (!veil.shown) return;
  ImGui::SameLine(0.0f, 20.0f);
  EditColor("Colour##veil", veil.color);
  Tip("of the veil");
  ImGui::SliderScalar("Veil at", ImGuiDataType_Double, &veil.isovalue, &min, &max, "%.5g");
  Tip("the veil's isovalue, yours alone; ctrl+click to type");
  const double least = 0.02;
  const double most = 1.0;
  ImGui::SliderScalar("Opacity", ImGuiDataType_Double, &veil.opacity, &least, &most, "%.2f");
  Tip("0: invisible, 1: opaque");
}

void EditOverlay(OverlayOptions& overlay) {
  ImGui::Checkbox("Haptic surface (H)", &overlay.haptic_surface);
  Tip("wireframe of what is felt near the proxy: it differs from what is seen");
  if (overlay.haptic_surface) {
    const double least = 2.0;
    const double most = 10.0;
    ImGui::SliderScalar("Radius##h", ImGuiDataType_Double, &overlay.haptic_surface_radius_voxels,
                        &least, &most, "%.0f voxels");
    Tip("how far from the proxy the wireframe goes");
  }
  ImGui::Checkbox("Points", &overlay.points);
  Tip("stylus tip, proxy and the point on the seen surface");
  SameLineIfFits("Force");
  ImGui::Checkbox("Force", &overlay.force);
  Tip("the force on the hand, as an arrow");
  SameLineIfFits("Stylus");
  ImGui::Checkbox("Stylus", &overlay.stylus);
  Tip("the shaft that the hand holds");
  SameLineIfFits("Box");
  ImGui::Checkbox("Box", &overlay.box);
  Tip("the volume's edges");
}

void EditSides(Viewer& viewer) {
  static const char* const sides[] = {"left at the right", "left at the left"};
  int side = static_cast<int>(viewer.slice_side());
  if (Choose("Slices", side, sides, 2)) viewer.SetSliceSide(static_cast<SliceSide>(side));
  Tip("the patient's left: at the right is radiological, at the left neurological");
  ImGui::Checkbox("Letters: left, right, ...", &viewer.state().overlay.letters);
  Tip("the patient's sides, at the box and at the slices");
}

}  // namespace

void LookPanel(Viewer& viewer) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Look")) return;
  const auto& lattice = viewer.feed().volume().lattice();
  const double min = lattice ? lattice->value_min : 0.0;
  const double max = lattice ? lattice->value_max : 1.0;
  ViewState& state = viewer.state();
  EditSurface(state.surface);
  EditVeil(state.surface.veil, min, max);
  EditOverlay(state.overlay);
  EditSides(viewer);
}

}  // namespace palpate::view
