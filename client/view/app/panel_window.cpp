#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/scene/value_window.h"

namespace palpate::view {
namespace {

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

}  // namespace

void WindowPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Window of the values")) return;
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

}  // namespace palpate::view
