#include <optional>
#include <string>
#include <variant>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/live/setting_control.h"

namespace palpate::view {
namespace {

// Draws the control of a setting. Returns true if the user changed it; `value` is then the user's,
// as ValueOf counts.
struct Control {
  Viewer& viewer;
  const client::Setting& setting;
  double& value;

  // Labels end with \0, as all texts of the list.
  bool operator()(const client::NumberSetting& number) const {
    return HeldSlider(viewer, setting.label.data(), value, number.minimum, number.maximum,
                      SliderFormat(setting).c_str());
  }
  bool operator()(const client::FlagSetting& /*flag*/) const {
    bool on = value > 0.5;
    const bool changed = HeldCheckbox(viewer, setting.label.data(), on);
    value = on ? 1.0 : 0.0;
    return changed;
  }
  bool operator()(const client::ChoiceSetting& choice) const {
    auto place = static_cast<std::size_t>(value);
    const bool changed = HeldChoice(viewer, setting.label.data(), place, choice.words);
    value = static_cast<double>(place);
    return changed;
  }
};

void EditSetting(Viewer& viewer, const client::Setting& setting, const client::Settings& settings) {
  double value = ValueOf(setting, settings);
  const double before = viewer.held().Shown(ImGui::GetID(setting.label.data()), value);
  const bool changed = std::visit(Control{viewer, setting, value}, setting.kind);
  Tip(setting.help.data());
  SharedSign(viewer, setting.key);
  if (changed) viewer.actions().Set(setting, before, value);
}

}  // namespace

void FeelPanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader(kFeelHeading)) return;
  const auto& settings = viewer.feed().settings();
  if (!settings) return;
  BeginAllowed(viewer, client::Role::kEditor);
  for (const client::Setting& setting : client::kHapticSettings) {
    if (IsShown(setting, *settings)) EditSetting(viewer, setting, *settings);
  }
  EndAllowed();
}

}  // namespace palpate::view
