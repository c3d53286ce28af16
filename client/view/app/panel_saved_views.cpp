#include <imgui_stdlib.h>

#include <optional>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

std::optional<AffineMap> PlaceInD(const ViewVolume& volume) {
  if (!volume.lattice() || !volume.X_DI()) return std::nullopt;
  return *volume.X_DI() * volume.lattice()->X_WI.Inverse();
}

void Keep(ViewState& state, const AffineMap& X_DW) {
  std::string name = OneLine(state.view_name, 100);
  if (name.empty()) name = "View " + std::to_string(state.saved_views.size() + 1);
  SavedView view = SaveView(name, state.camera, state.surface, state.cross_I, X_DW);
  // A name stands for one view: the newest.
  std::erase_if(state.saved_views, [&](const SavedView& old) { return old.name == name; });
  state.saved_views.push_back(std::move(view));
  state.view_name.clear();
}

}  // namespace

void SavedViewsPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Saved views")) return;
  ViewState& state = viewer.state();
  const std::optional<AffineMap> X_DW = PlaceInD(viewer.feed().volume());
  if (!X_DW) return;
  const char* save = "Save the view";
  ImGui::SetNextItemWidth(-ButtonWidth(save) - ImGui::GetStyle().ItemSpacing.x);
  ImGui::InputTextWithHint("##name", "its name", &state.view_name);
  Tip("a name that is there already is replaced");
  ImGui::SameLine();
  if (ImGui::Button(save)) Keep(state, *X_DW);
  Tip("keeps camera, cuts, window and cross-hair");
  std::optional<std::size_t> removed;
  for (std::size_t n = 0; n < state.saved_views.size(); ++n) {
    const SavedView& view = state.saved_views[n];
    ImGui::PushID(static_cast<int>(n));
    if (ImGui::Button(view.name.c_str())) {
      ShowView(view, *X_DW, state.camera, state.surface, state.cross_I);
      state.cross_follows_proxy = false;
      state.planes_placed.fill(true);
    }
    Tip("shows this view again");
    ImGui::SameLine();
    if (ImGui::SmallButton("Remove")) removed = n;
    Tip("removes this view from the list");
    ImGui::PopID();
  }
  if (removed) state.saved_views.erase(state.saved_views.begin() + static_cast<long>(*removed));
}

}  // namespace palpate::view
