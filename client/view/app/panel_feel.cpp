#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

using Number = std::optional<double> client::SettingsUpdate::*;
using Flag = std::optional<bool> client::SettingsUpdate::*;

void Slider(Viewer& viewer, const char* label, Number key, double value, double most,
            const char* format) {
  if (!HeldSlider(viewer, label, value, 0.0, most, format)) return;
  client::SettingsUpdate update;
  update.*key = value;
  viewer.feed().commands().Set(update);
}

void Check(Viewer& viewer, const char* label, Flag key, bool value) {
  if (!HeldCheckbox(viewer, label, value)) return;
  client::SettingsUpdate update;
  update.*key = value;
  viewer.feed().commands().Set(update);
}

void EditEffects(Viewer& viewer, const client::Settings& s) {
  using Update = client::SettingsUpdate;
  Slider(viewer, "Stiffness", &Update::stiffness_n_per_mm, s.stiffness_n_per_mm, 3.0, "%.2f N/mm");
  Slider(viewer, "Damping", &Update::damping_n_s_per_m, s.damping_n_s_per_m, 5.0,
         "%.2f N\xC2\xB7s/m");
  Slider(viewer, "Static friction", &Update::static_friction, s.static_friction, 2.0, "%.2f");
  Slider(viewer, "Sliding friction", &Update::dynamic_friction, s.dynamic_friction, 2.0, "%.2f");
  Slider(viewer, "Viscosity", &Update::viscosity_n_s_per_m, s.viscosity_n_s_per_m, 5.0,
         "%.2f N\xC2\xB7s/m");
  Slider(viewer, "Pops through at", &Update::pop_force_n, s.pop_force_n, 3.3, "%.2f N");
  Slider(viewer, "Magnet", &Update::magnet_force_n, s.magnet_force_n, 1.5, "%.2f N");
  Slider(viewer, "Magnet's range", &Update::magnet_range_mm, s.magnet_range_mm, 10.0, "%.1f mm");
  Check(viewer, "Force shading", &Update::force_shading, s.force_shading);
  Check(viewer, "Passivity control", &Update::passivity_control, s.passivity_control);
}

void EditTools(Viewer& viewer, const client::Settings& s) {
  using Update = client::SettingsUpdate;
  Check(viewer, "Button 0 carves", &Update::carve_tool, s.carve_tool);
  if (s.carve_tool) {
    Slider(viewer, "Carve radius", &Update::carve_radius_mm, s.carve_radius_mm, 20.0, "%.1f mm");
  }
  Check(viewer, "Button 1 moves the volume", &Update::clutch_tool, s.clutch_tool);
  bool above = s.free_side == client::FreeSide::kAbove;
  if (HeldCheckbox(viewer, "Free above the isovalue", above)) {
    viewer.feed().commands().Set(
        {.free_side = above ? client::FreeSide::kAbove : client::FreeSide::kBelow});
  }
}

}  // namespace

void FeelPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Feel, for everyone")) return;
  const auto& settings = viewer.feed().settings();
  if (!settings) return;
  BeginAllowed(viewer, client::Role::kEditor);
  EditEffects(viewer, *settings);
  EditTools(viewer, *settings);
  EndAllowed();
}

}  // namespace palpate::view
