// The Surface tab: the isovalue, and the layers.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

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

// Layers are felt neither with a tool nor from above: the button that ends that. Returns false if
// nothing is in their way.
bool OfferLayers(Viewer& viewer, const client::Settings& settings) {
  const auto offer = [&](const char* why, const char* label, const client::SettingsUpdate& update) {
    WrappedText(kDim, why);
    if (ImGui::Button(label)) viewer.feed().commands().Set(update);
    return true;
  };
  if (!settings.tool.ball.empty()) {
    return offer("layers are not felt with a tool", "Put the tool down", {.tool = HeldTool()});
  }
  if (settings.free_side == client::FreeSide::kBelow) return false;
  return offer("layers are felt from below only", "Feel it from below",
               {.free_side = client::FreeSide::kBelow});
}

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
  if (OfferLayers(viewer, *viewer.feed().settings())) return EndAllowed();
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

constexpr ThemeColor kMaterial(&Palette::material);
constexpr ThemeColor kOtherBars(&Palette::other_bars);

struct Scale {
  double min;
  double max;
  Area area;

  float X(double value) const {
    const double share = max > min ? (value - min) / (max - min) : 0.0;
    return area.min.x + area.size.x * static_cast<float>(std::clamp(share, 0.0, 1.0));
  }
  double Value(float x) const {
    const double share = static_cast<double>((x - area.min.x) / area.size.x);
    return min + std::clamp(share, 0.0, 1.0) * (max - min);
  }
};

// Logarithmic, so that a thin skin is as visible as the air around it.
void DrawBars(const Histogram& histogram, const Scale& scale, double isovalue, bool free_above) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const Histogram::Bars bars = histogram.bars();
  const double greatest =
      std::log1p(static_cast<double>(*std::max_element(bars.counts.begin(), bars.counts.end())));
  if (greatest <= 0.0) return;
  const float bottom = scale.area.min.y + scale.area.size.y;
  for (std::size_t bar = 0; bar < bars.counts.size(); ++bar) {
    const double value = bars.first + static_cast<double>(bar) * bars.width;
    const double share = std::log1p(static_cast<double>(bars.counts[bar])) / greatest;
    const bool material = free_above ? value <= isovalue : value >= isovalue;
    list.AddRectFilled({scale.X(value - 0.5 * bars.width),
                        bottom - static_cast<float>(share) * (scale.area.size.y - 8.0f)},
                       {scale.X(value + 0.5 * bars.width), bottom},
                       (material ? kMaterial : kOtherBars).u32());
  }
}

void DrawMark(const Scale& scale, double value, ImU32 color, float width) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float x = scale.X(value);
  const float top = scale.area.min.y;
  list.AddLine({x, top}, {x, top + scale.area.size.y}, color, width);
  list.AddTriangleFilled({x - 5.0f, top}, {x + 5.0f, top}, {x, top + 7.0f}, color);
}

ImU32 ColorOf(const Rgb& c, float alpha = 1.0f) {
  return ImGui::ColorConvertFloat4ToU32({c.x(), c.y(), c.z(), alpha});
}

// A mark for each layer, and the band between two of them that SCP_H is in.
void DrawLayers(const SurfaceLayers& layers, const std::optional<client::Pose>& pose,
                const Scale& scale) {
  const std::size_t count = layers.layer.size();
  if (pose) {
    const std::size_t passed = std::min<std::size_t>(pose->layers_passed, count);
    const double low = passed > 0 ? layers.layer[passed - 1].isovalue : scale.min;
    const double high = passed < count ? layers.layer[passed].isovalue : scale.max;
    const float top = scale.area.min.y;
    ImGui::GetWindowDrawList()->AddRectFilled(
        {scale.X(low), top}, {scale.X(high), top + scale.area.size.y}, ColorOf(Rgb::Ones(), 0.15f));
  }
  for (const SurfaceLayer& layer : layers.layer) {
    DrawMark(scale, layer.isovalue, ColorOf(LayerColor(static_cast<int>(layer.id))), 2.0f);
  }
}

// The isovalues that palpated suggests, with their names below each other.
void DrawSuggestions(const std::vector<client::SuggestedIsovalue>& suggestions,
                     const Scale& scale) {
  const ImU32 color = ThemeColor(&Palette::suggestion).u32();
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float top = scale.area.min.y;
  float y = top;
  for (const client::SuggestedIsovalue& suggested : suggestions) {
    const float x = scale.X(suggested.isovalue);
    list.AddLine({x, top}, {x, top + scale.area.size.y}, color, 1.0f);
    list.AddText({x + 6.0f, y}, color, suggested.name.c_str());
    y += ImGui::GetFontSize();
  }
}

// Near the mark of a suggestion, its isovalue.
double Snapped(const std::vector<client::SuggestedIsovalue>& suggestions, const Scale& scale,
               float x) {
  constexpr float kNear = 5.0f;
  for (const client::SuggestedIsovalue& suggested : suggestions) {
    if (std::abs(scale.X(suggested.isovalue) - x) > kNear) continue;
    ImGui::SetTooltip("%s, %.6g: %s", suggested.name.c_str(), suggested.isovalue,
                      suggested.reason.c_str());
    return suggested.isovalue;
  }
  return scale.Value(x);
}

// Returns true while the user drags.
bool DragOnHistogram(Viewer& viewer, double& isovalue) {
  const Histogram& histogram = viewer.feed().volume().histogram();
  const ImVec2 size{ImGui::GetContentRegionAvail().x, 96.0f * viewer.state().screen_scale};
  const Scale scale{histogram.min(), histogram.max(), {ImGui::GetCursorScreenPos(), size}};
  ImGui::InvisibleButton("histogram", scale.area.size);
  // The keyboard can choose it, too, while the pointer is anywhere.
  const bool held = ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left);
  const auto info = viewer.feed().volume_info();
  const auto suggestions = info.value_or(client::VolumeInfo()).suggested_isovalues;
  if (ImGui::IsItemHovered() || held) {
    const double snapped = Snapped(suggestions, scale, ImGui::GetIO().MousePos.x);
    if (held) isovalue = snapped;
    ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeEW);
  }
  ImGui::GetWindowDrawList()->AddRectFilled(scale.area.min, MaxOf(scale.area),
                                            ThemeColor(&Palette::histogram).u32());
  const SurfaceOptions& surface = viewer.state().surface;
  DrawBars(histogram, scale, isovalue, surface.free_above);
  if (surface.veil.shown) {
    const Rgb& c = surface.veil.color;
    DrawMark(scale, surface.veil.isovalue, ColorOf(c), 1.0f);
  }
  DrawSuggestions(suggestions, scale);
  const SurfaceLayers layers = viewer.ShownLayers();
  if (layers.layer.empty()) {
    DrawMark(scale, isovalue, ThemeColor(&Palette::isovalue).u32(), 2.0f);
    return held;
  }
  DrawLayers(layers, viewer.feed().pose(), scale);
  return false;
}

void EditIsovalue(Viewer& viewer, const VolumeLattice& lattice, const client::Settings& settings) {
  constexpr unsigned kControl = Viewer::kIsovalueControl;
  const double before = viewer.held().Shown(kControl, settings.isovalue);
  double isovalue = before;
  bool held = DragOnHistogram(viewer, isovalue);
  // Each layer has its own.
  if (!settings.layers.layer.empty()) return;
  const double range = lattice.value_max - lattice.value_min;
  ImGui::SetNextItemWidth(ImGui::GetContentRegionAvail().x * 0.4f);
  DragDouble("##isovalue", isovalue, range / 1000.0, lattice.value_min, lattice.value_max, "%.6g");
  held = held || ImGui::IsItemActive();
  Tip("drag, or ctrl+click to type and press Enter; it changes for everyone");
  const std::string share = fmt::format(
      "{:.1f} % of range", range > 0.0 ? 100.0 * (isovalue - lattice.value_min) / range : 0.0);
  const bool is_beside = UnitText(lattice.unit, ImGui::CalcTextSize(share.c_str()).x +
                                                    ImGui::GetStyle().ItemSpacing.x +
                                                    ImGui::GetTextLineHeight() + 5.0f);
  if (is_beside) ImGui::SameLine();
  ImGui::TextColored(kDim, "%s", share.c_str());
  SharedSign(viewer, client::kIsovalue.key);
  const bool changed = isovalue != before;
  viewer.held().Update(kControl, isovalue, changed, held);
  if (changed) viewer.actions().Set(client::kIsovalue, before, isovalue);
}

}  // namespace

void SurfaceTab(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("Isovalue", ImGuiTreeNodeFlags_DefaultOpen)) return;
  const auto& lattice = viewer.feed().volume().lattice();
  const auto& settings = viewer.feed().settings();
  if (!lattice || !settings) {
    ImGui::TextColored(kDim, "no volume yet");
    return;
  }
  BeginAllowed(viewer, client::Role::kEditor);
  EditIsovalue(viewer, *lattice, *settings);
  EndAllowed();
  LayersPanel(viewer);
}

}  // namespace palpate::view
