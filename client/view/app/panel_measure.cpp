#include <optional>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {

void MeasurePanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Distances")) return;
  MeasureState& measure = viewer.state().measure;
  // Saved views have buttons of the same names.
  ImGui::PushID("distances");
  std::optional<std::size_t> removed;
  for (std::size_t n = 0; n < measure.distances.size(); ++n) {
    ImGui::PushID(static_cast<int>(n));
    ImGui::Text("%zu: %s", n + 1, TextOf(measure.distances[n]).c_str());
    ImGui::SameLine();
    if (ImGui::SmallButton("Remove")) removed = n;
    Tip("removes this distance");
    ImGui::PopID();
  }
  ImGui::PopID();
  if (removed) measure.Remove(*removed);
  ImGui::BeginDisabled(measure.distances.empty());
  if (ImGui::Button("Remove all distances")) measure.Clear();
  Tip("the Delete key removes the last one");
  ImGui::EndDisabled();
}

}  // namespace palpate::view
