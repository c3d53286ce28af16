// The layers, for everyone: what is felt one behind the other, below the histogram.
#include <algorithm>
#include <string>

#include "client/view/drawing/value_window.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

constexpr std::size_t kMostLayers = 8;
constexpr double kSoftNPerMm = 0.3, kFirmNPerMm = 1.0, kSoftPopN = 1.0;

SurfaceLayer NewLayer(const SurfaceLayers& layers, const std::string& name, double isovalue,
                      bool holds) {
  SurfaceLayer layer{.name = name, .isovalue = isovalue};
  const auto has_name = [&](const SurfaceLayer& other) { return other.name == layer.name; };
  while (std::ranges::any_of(layers.layer, has_name)) layer.name += "'";
  layer.stiffness_n_per_mm = holds ? kFirmNPerMm : kSoftNPerMm;
  layer.pop_force_n = holds ? 0.0 : kSoftPopN;
  return layer;
}

// Where the stylus is, in words; "" without layers or poses.
std::string WhereInWords(const SurfaceLayers& layers, const client::Pose& pose) {
  const std::size_t passed = std::min<std::size_t>(pose.layers_passed, layers.layer.size());
  for (const SurfaceLayer& layer : layers.layer) {
    if (layer.id == pose.contact_layer && layer.id != 0) return "the stylus touches " + layer.name;
  }
  if (passed == 0) return "the stylus is outside";
  const std::string behind = "the stylus is behind " + layers.layer[passed - 1].name;
  return passed == layers.layer.size() ? behind : behind + ", before " + layers.layer[passed].name;
}

// Returns true if the user changed the layer; sets `removed`.
bool EditLayer(Viewer& viewer, SurfaceLayer& layer, double speed, bool& removed) {
  ImGui::PushID(layer.name.c_str());
  const Rgb& c = LayerColor(static_cast<int>(layer.id));
  ImGui::ColorButton("##color", {c.x(), c.y(), c.z(), 1.0f},
                     ImGuiColorEditFlags_NoTooltip | ImGuiColorEditFlags_NoDragDrop);
  ImGui::SameLine();
  ImGui::TextUnformatted(OneLine(layer.name, 31).c_str());
  ImGui::SameLine();
  const float right = ImGui::GetWindowContentRegionMax().x - ButtonWidth("Remove");
  ImGui::SetCursorPosX(std::max(ImGui::GetCursorPosX(), right));
  removed = ImGui::SmallButton("Remove");
  Tip("removes this layer for everyone");
  const auto& lattice = *viewer.feed().volume().lattice();
  bool changed =
      DragDouble("Isovalue", layer.isovalue, speed, lattice.value_min, lattice.value_max, "%.6g");
  changed |= SliderDouble("Stiffness", layer.stiffness_n_per_mm, 0.0, 3.0, "%.2f N/mm");
  changed |= SliderDouble("Pops at", layer.pop_force_n, 0.0, 3.3, "%.2f N");
  Tip("force at which the stylus passes through it; 0: never");
  changed |= SliderDouble("Friction", layer.dynamic_friction, 0.0, 2.0, "%.2f");
  ImGui::PopID();
  return changed || removed;
}

}  // namespace

void LayersPanel(Viewer& viewer) {
  const auto& lattice = viewer.feed().volume().lattice();
  if (!lattice || !viewer.feed().settings()) return;
  SurfaceLayers layers = viewer.ShownLayers();
  const bool has_layers = !layers.layer.empty();
  if (!ImGui::CollapsingHeader("Layers, for everyone",
                               has_layers ? ImGuiTreeNodeFlags_DefaultOpen : 0)) {
    return;
  }
  BeginAllowed(viewer, client::Role::kEditor);
  const double range = lattice->value_max - lattice->value_min;
  bool changed = false;
  std::optional<std::size_t> gone;
  for (std::size_t n = 0; n < layers.layer.size(); ++n) {
    bool removed = false;
    changed |= EditLayer(viewer, layers.layer[n], range / 1000.0, removed);
    if (removed) gone = n;
  }
  if (gone) layers.layer.erase(layers.layer.begin() + static_cast<std::ptrdiff_t>(*gone));
  ImGui::BeginDisabled(layers.layer.size() >= kMostLayers);
  if (ImGui::Button("Add a layer")) {
    double at = viewer.feed().settings()->isovalue;
    if (has_layers) at = layers.layer.back().isovalue;
    if (has_layers) at += std::min(0.1 * range, 0.5 * (lattice->value_max - at));
    layers.layer.push_back(NewLayer(layers, has_layers ? "layer" : "surface", at, true));
    changed = true;
  }
  ImGui::EndDisabled();
  Tip("surfaces that are felt one behind the other, each with its own stiffness");
  if (HasHounsfieldUnits(*lattice)) {
    ImGui::SameLine();
    if (ImGui::Button("Skin and bone")) {
      layers.layer = {NewLayer({}, "skin", -300.0, false)};
      layers.layer.push_back(NewLayer(layers, "bone", 300.0, true));
      changed = true;
    }
    Tip("skin at -300 HU lets the stylus pass at 1 N, bone at 300 HU holds");
  }
  SharedSign(viewer, "layers");
  if (changed) viewer.SetLayers(layers);
  EndAllowed();
  if (const auto& pose = viewer.feed().pose(); pose && !layers.layer.empty()) {
    WrappedText(kDim, WhereInWords(layers, *pose));
  }
}

}  // namespace palpate::view
