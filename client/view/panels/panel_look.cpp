// The Look tab: colours, the window of the values, distances, saved views.
#include <imgui.h>
#include <imgui_stdlib.h>

#include <ctime>

#include "client/view/drawing/value_window.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

// In the order of SurfaceColoring and of SliceSide.
constexpr std::string_view kColorings[] = {"one colour", "by height", "by slope"};
constexpr std::string_view kSliceSides[] = {"left at the right", "left at the left"};
// A full list loses its oldest view.
constexpr std::size_t kMostViews = 100;

void EditColor(const char* label, Rgb& color) {
  ImGui::ColorEdit3(label, color.data(), ImGuiColorEditFlags_NoInputs);
}

void EditSurface(SurfaceOptions& surface) {
  ImGui::Checkbox("Surface", &surface.shown);
  Tip("show the isosurface that is felt");
  ImGui::SameLine(0.0f, 20.0f);
  EditColor("Colour", surface.color);
  Tip("of the surface, where it has one colour");
  Choose("Colouring", surface.coloring, kColorings);
  Tip("by height: along the view's upright axis; by slope: how steep the values are");
  Choose("Colour map", surface.color_map, kColorMapNames);
}

void EditVeil(Veil& veil, double min, double max) {
  ImGui::Checkbox("Veil (V)", &veil.shown);
  Tip("a second, translucent isosurface");
  if (!veil.shown) return;
  ImGui::SameLine(0.0f, 20.0f);
  EditColor("Colour##veil", veil.color);
  Tip("of the veil");
  SliderDouble("Veil at", veil.isovalue, min, max, "%.5g");
  Tip("the veil's isovalue, yours alone; ctrl+click to type");
  SliderDouble("Opacity", veil.opacity, 0.02, 1.0, "%.2f");
  Tip("0: invisible, 1: opaque");
}

// The check box with this text follows on the same line, or on a new one in a narrow side.
void SameLineIfFits(const char* label) {
  ImGui::SameLine();
  const float width =
      ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x + ImGui::CalcTextSize(label).x;
  if (ImGui::GetContentRegionAvail().x < width) ImGui::NewLine();
}

void EditOverlay(OverlayOptions& overlay) {
  ImGui::Checkbox("Haptic surface (H)", &overlay.haptic_surface);
  Tip("wireframe of what is felt near the proxy: it differs from what is seen");
  if (overlay.haptic_surface) {
    SliderDouble("Radius##h", overlay.haptic_surface_radius_voxels, 2.0, 10.0, "%.0f voxels");
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
  SliceSide side = viewer.slice_side();
  if (Choose("Slices", side, kSliceSides)) viewer.SetSliceSide(side);
  Tip("the patient's left: at the right is radiological, at the left neurological");
  ImGui::Checkbox("Letters: left, right, ...", &viewer.state().overlay.letters);
  Tip("the patient's sides, at the box and at the slices");
}

void LookPart(Viewer& viewer) {
  const auto& lattice = viewer.feed().volume().lattice();
  const double min = lattice ? lattice->value_min : 0.0;
  const double max = lattice ? lattice->value_max : 1.0;
  ViewState& state = viewer.state();
  EditSurface(state.surface);
  EditVeil(state.surface.veil, min, max);
  EditOverlay(state.overlay);
  EditSides(viewer);
}

void Show(const ValueWindow& window, SurfaceOptions& surface) {
  surface.window_min = window.min();
  surface.window_max = window.max();
}

// Buttons in a row, as many as fit.
bool NextButton(const char* label) {
  const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x;
  const float next = ImGui::GetItemRectMax().x + ImGui::GetStyle().ItemSpacing.x;
  if (next + ButtonWidth(label) < right) ImGui::SameLine();
  return ImGui::Button(label);
}

void ChoosePreset(const VolumeLattice& lattice, SurfaceOptions& surface) {
  if (ImGui::Button("Whole range")) Show(WholeRange(lattice), surface);
  Tip("from the least to the greatest value of the volume");
  if (const auto of_file = WindowOfFile(lattice)) {
    if (NextButton("As in the file")) Show(*of_file, surface);
    Tip("the window that the file proposes");
  }
  if (!HasHounsfieldUnits(lattice)) return;
  for (const WindowPreset& preset : kWindowPresets) {
    if (NextButton(std::string(preset.name).c_str())) Show(preset.window, surface);
    if (ImGui::IsItemHovered()) {
      ImGui::SetTooltip("level %.0f, width %.0f HU", preset.window.level, preset.window.width);
    }
  }
}

void WindowPart(Viewer& viewer) {
  const auto& lattice = viewer.feed().volume().lattice();
  if (!lattice) return;
  SurfaceOptions& surface = viewer.state().surface;
  const ValueWindow whole = WholeRange(*lattice);
  ValueWindow window = ValueWindow::Between(surface.window_min, surface.window_max);
  const double speed = whole.width / 500.0;
  bool changed = DragDouble("Level", window.level, speed, whole.level - whole.width,
                            whole.level + whole.width, "%.5g");
  Tip("the value in the middle of the colour map; up and down with the right button on a slice");
  changed |=
      DragDouble("Width", window.width, speed, 1e-3 * whole.width, 4.0 * whole.width, "%.5g");
  Tip("from the colour map's first colour to its last; left and right with the right button");
  if (changed) Show(window, surface);
  ChoosePreset(*lattice, surface);
}

// Draws a list by `draw(n)`, each line with a button that removes it; `name` keeps the buttons of
// two lists apart. Returns the line to remove.
template <class Draw>
std::optional<std::size_t> RemovableLines(const char* name, std::size_t count, const char* tip,
                                          const Draw& draw) {
  std::optional<std::size_t> removed;
  ImGui::PushID(name);
  for (std::size_t n = 0; n < count; ++n) {
    ImGui::PushID(static_cast<int>(n));
    draw(n);
    ImGui::SameLine();
    if (ImGui::SmallButton("Remove")) removed = n;
    Tip(tip);
    ImGui::PopID();
  }
  ImGui::PopID();
  return removed;
}

void DistancesPart(MeasureState& measure) {
  const auto removed = RemovableLines(
      "distances", measure.distances.size(), "removes this distance",
      [&](std::size_t n) { ImGui::Text("%zu: %s", n + 1, TextOf(measure.distances[n]).c_str()); });
  if (removed) measure.Remove(*removed);
  ImGui::BeginDisabled(measure.distances.empty());
  if (ImGui::Button("Remove all distances")) measure.Clear();
  Tip("the Delete key removes the last one");
  ImGui::EndDisabled();
}

void Keep(ViewState& state, std::vector<SavedView>& views, const AffineMap& X_DW) {
  std::string name = OneLine(state.view_name, 100);
  if (name.empty()) name = "View " + std::to_string(views.size() + 1);
  SavedView view = SaveView(name, state.camera, state.surface, state.cross_I, X_DW);
  view.saved_s = std::time(nullptr);
  // Replaces the view of the same name.
  std::erase_if(views, [&](const SavedView& old) { return old.name == name; });
  if (views.size() >= kMostViews) views.erase(views.begin());
  views.push_back(std::move(view));
  state.view_name.clear();
}

void SavedViewsPart(Viewer& viewer) {
  ViewState& state = viewer.state();
  const std::optional<AffineMap> X_DW = viewer.feed().volume().X_DW();
  if (!X_DW) return;
  auto& views = viewer.preferences().saved_views[viewer.feed().volume().lattice()->source];
  const char* save = "Save the view";
  ImGui::SetNextItemWidth(-ButtonWidth(save) - ImGui::GetStyle().ItemSpacing.x);
  ImGui::InputTextWithHint("##name", "its name", &state.view_name);
  Tip("a name that is there already is replaced");
  ImGui::SameLine();
  if (ImGui::Button(save)) Keep(state, views, *X_DW);
  Tip("keeps camera, cuts, window and cross-hair");
  const auto removed =
      RemovableLines("views", views.size(), "removes this view from the list", [&](std::size_t n) {
        if (NameButton(views[n].name)) {
          ShowView(views[n], *X_DW, state.camera, state.surface, state.cross_I);
          state.cross_follows_proxy = false;
          state.cuts.planes_placed.fill(true);
        }
        Tip("shows this view again");
      });
  if (removed) views.erase(views.begin() + static_cast<std::ptrdiff_t>(*removed));
}

}  // namespace

void LookTab(Viewer& viewer) {
  if (ImGui::CollapsingHeader("Look", ImGuiTreeNodeFlags_DefaultOpen)) LookPart(viewer);
  if (ImGui::CollapsingHeader("Window of the values")) WindowPart(viewer);
  if (ImGui::CollapsingHeader("Distances")) DistancesPart(viewer.state().measure);
  if (ImGui::CollapsingHeader("Saved views")) SavedViewsPart(viewer);
}

}  // namespace palpate::view
