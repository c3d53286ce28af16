#include <algorithm>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

void EditBrush(Viewer& viewer) {
  BrushOptions& brush = viewer.state().brush;
  static const char* const operations[] = {"remove", "add", "subtract", "set", "smooth", "paint"};
  int operation = brush.removes ? 0 : 1 + static_cast<int>(brush.operation);
  if (Choose("Operation", operation, operations, 6)) {
    brush.removes = operation == 0;
    if (operation > 0) brush.operation = static_cast<client::EditOperation>(operation - 1);
  }
  Tip("what a stroke does, once for each voxel, within the volume's range of values; remove makes "
      "them free space");
  SharedSign(viewer, "voxels");
  DragDouble("Radius", brush.radius_mm, 0.05, kLeastBrush_mm, kGreatestBrush_mm, "%.2f mm");
  Tip("of the ball that is shown at the pointer, in mm of the volume ([ and ], comma and point, "
      "ctrl + wheel)");
  DragDouble("Fades over", brush.falloff_mm, 0.05, 0.0, 100.0, "%.2f mm");
  Tip("outside of the ball, to the fainter line");
  const auto& lattice = viewer.feed().volume().lattice();
  const double range = lattice ? lattice->value_max - lattice->value_min : 1.0;
  if (brush.removes) return;
  if (brush.operation != client::EditOperation::kSmooth) {
    DragDouble("Value", brush.value, range / 500.0, -1e9, 1e9, "%.5g");
    Tip("data units");
    if (lattice) UnitText(lattice->unit);
  }
  if (brush.operation == client::EditOperation::kSmooth ||
      brush.operation == client::EditOperation::kPaint) {
    DragDouble("Strength", brush.strength, 0.01, 0.01, 1.0, "%.2f");
    Tip("the share of the full change");
  }
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
