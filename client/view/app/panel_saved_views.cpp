#include <imgui.h>
#include <imgui_stdlib.h>

#include <ctime>
#include <optional>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

// A full list loses its oldest view.
constexpr std::size_t kMostViews = 100;

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

}  // namespace

void SavedViewsPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Saved views")) return;
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
  // Distances have buttons of the same names.
  ImGui::PushID("views");
  std::optional<std::size_t> removed;
  for (std::size_t n = 0; n < views.size(); ++n) {
    const SavedView& view = views[n];
    ImGui::PushID(static_cast<int>(n));
    if (NameButton(view.name)) {
      ShowView(view, *X_DW, state.camera, state.surface, state.cross_I);
      state.cross_follows_proxy = false;
      state.cuts.planes_placed.fill(true);
    }
    Tip("shows this view again");
    ImGui::SameLine();
    if (ImGui::SmallButton("Remove")) removed = n;
    Tip("removes this view from the list");
    ImGui::PopID();
  }
  ImGui::PopID();
  if (removed) views.erase(views.begin() + static_cast<std::ptrdiff_t>(*removed));
}

}  // namespace palpate::view
