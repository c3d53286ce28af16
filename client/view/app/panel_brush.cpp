#include <algorithm>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

void EditBrush(Viewer& viewer) {
  BrushOptions& brush = viewer.state().brush;
  bool on = viewer.state().tool == Tool::kBrush;
  if (ImGui::Checkbox("Drag on the surface edits (B)", &on)) {
    viewer.state().tool = on ? Tool::kBrush : Tool::kTurn;
  }
  Tip("edits change the volume for everyone");
  SharedSign(viewer, "voxels");
  static const char* const operations[] = {"add", "subtract", "set", "smooth", "paint"};
  int operation = static_cast<int>(brush.operation);
  if (Choose("Operation", operation, operations, 5)) {
    brush.operation = static_cast<client::EditOperation>(operation);
  }
  Tip("what the brush does to the values within it");
  DragDouble("Radius", brush.radius_mm, 0.05, 0.1, 100.0, "%.2f mm");
  Tip("of the ball that the brush is; ctrl+click to type");
  DragDouble("Fades over", brush.falloff_mm, 0.05, 0.0, 100.0, "%.2f mm");
  Tip("how soft its border is; 0: sharp");
  const auto& lattice = viewer.feed().volume().lattice();
  const double range = lattice ? lattice->value_max - lattice->value_min : 1.0;
  if (brush.operation != client::EditOperation::kSmooth) {
    DragDouble("Value", brush.value, range / 500.0, -1e9, 1e9, "%.5g");
    Tip("the value that is added, subtracted, set or painted");
    if (lattice) UnitText(lattice->unit);
  }
  if (brush.operation == client::EditOperation::kSmooth ||
      brush.operation == client::EditOperation::kPaint) {
    DragDouble("Strength", brush.strength, 0.01, 0.01, 1.0, "%.2f");
    Tip("the share of the way that one touch goes");
  }
  UndoButtons(viewer);
}

// Filters all voxels, as one step of the brush's history.
void Denoise(Viewer& viewer) {
  static const char* const kinds[] = {"gaussian", "mean", "median"};
  Denoiser& denoiser = viewer.feed().denoiser();
  client::Filter& filter = viewer.state().denoise;
  ImGui::Separator();
  const std::optional<double> fraction = denoiser.fraction();
  if (fraction) {
    ImGui::ProgressBar(static_cast<float>(*fraction),
                       {0.58f * ImGui::GetContentRegionAvail().x, 0});
    ImGui::SameLine();
    if (ImGui::Button("Cancel")) denoiser.Cancel();
    Tip("the volume stays as it was");
  } else if (ImGui::Button("Denoise the volume")) {
    denoiser.Start(filter, viewer.brush().OtherStroke());
  }
  int kind = static_cast<int>(filter.kind);
  if (Choose("Filter", kind, kinds, 3)) filter.kind = static_cast<client::FilterKind>(kind);
  Tip("median keeps edges; gaussian and mean soften them");
  ImGui::SliderInt("Width in voxels", &filter.width, 1, 8, "%d", ImGuiSliderFlags_AlwaysClamp);
  Tip("how far around a voxel the filter looks");
  if (const std::string problem = denoiser.problem(); !problem.empty()) {
    ImGui::PushStyleColor(ImGuiCol_Text, kWarning);
    ImGui::TextUnformatted(OneLine(problem, 200).c_str());
    ImGui::PopStyleColor();
  }
}

}  // namespace

void BrushPanel(Viewer& viewer) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Brush")) return;
  BeginAllowed(viewer, client::Role::kEditor);
  EditBrush(viewer);
  Denoise(viewer);
  EndAllowed();
}

}  // namespace palpate::view
