#include <algorithm>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

void EditBrush(Viewer& viewer) {
  BrushOptions& brush = viewer.state().brush;
  static const char* const operations[] = {"add", "subtract", "set", "smooth", "paint"};
  int operation = static_cast<int>(brush.operation);
  if (Choose("Operation", operation, operations, 5)) {
    brush.operation = static_cast<client::EditOperation>(operation);
  }
  Tip("what a stroke does to the values; with material above the isovalue, subtract removes");
  SharedSign(viewer, "voxels");
  DragDouble("Radius", brush.radius_mm, 0.05, kLeastBrush_mm, kGreatestBrush_mm, "%.2f mm");
  Tip("of the ball that is shown at the pointer, in mm of the volume ([ and ], comma and point, "
      "ctrl + wheel)");
  DragDouble("Fades over", brush.falloff_mm, 0.05, 0.0, 100.0, "%.2f mm");
  Tip("outside of the ball, to the fainter line");
  const auto& lattice = viewer.feed().volume().lattice();
  const double range = lattice ? lattice->value_max - lattice->value_min : 1.0;
  if (brush.operation != client::EditOperation::kSmooth) {
    DragDouble("Value", brush.value, range / 500.0, -1e9, 1e9, "%.5g");
    Tip("data units; where strokes overlap, they add up");
    if (lattice) UnitText(lattice->unit);
  }
  if (brush.operation == client::EditOperation::kSmooth ||
      brush.operation == client::EditOperation::kPaint) {
    DragDouble("Strength", brush.strength, 0.01, 0.01, 1.0, "%.2f");
    Tip("the share of the full change");
  }
  UndoButtons(viewer);
}

}  // namespace

void BrushPanel(Viewer& viewer) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Brush")) return;
  BeginAllowed(viewer, client::Role::kEditor);
  EditBrush(viewer);
  EndAllowed();
}

}  // namespace palpate::view
