#include <string_view>

#include "client/view/app/overlays.h"
#include "client/view/app/theme.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

// Empty: nothing to ask. Built-in shapes have no face.
std::string_view LineOf(const Viewer& viewer) {
  const ViewVolume& volume = viewer.feed().volume();
  if (volume.axes_are_answered()) return "sides as answered";
  if (!volume.patient_axes().empty() || volume.lattice()->source.starts_with("builtin:")) return {};
  return "which way does it face?";
}

ImVec2 ExtentOf(std::string_view line) {
  return ImGui::CalcTextSize(line.data(), line.data() + line.size());
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

}  // namespace

void AskFacing(Viewer& viewer, const ImVec2& right_top, float scale) {
  const std::string_view line = LineOf(viewer);
  if (line.empty()) return;
  const ImVec2 extent = ExtentOf(line);
  const ImVec2 before = ImGui::GetCursorScreenPos();
  ImGui::SetCursorScreenPos({right_top.x - extent.x, right_top.y});
  if (ImGui::InvisibleButton("facing line", {extent.x, extent.y + 2.0f * scale})) {
    viewer.state().facing = {viewer.feed().volume().lattice()->loaded_revision};
    ImGui::OpenPopup("facing");
  }
  Tip("where face and head point, for everybody and for this file");
  FacingPopup(viewer);
  ImGui::SetCursorScreenPos(before);
}

void DrawFacing(const Viewer& viewer, const ImVec2& right_top) {
  const std::string_view line = LineOf(viewer);
  if (line.empty()) return;
  const ImVec2 at = {right_top.x - ExtentOf(line).x, right_top.y};
  ImGui::GetWindowDrawList()->AddText(at, kDim.u32(), line.data(), line.data() + line.size());
}

}  // namespace palpate::view
