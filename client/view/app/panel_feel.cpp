#include <optional>
#include <string>
#include <variant>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/live/setting_control.h"

namespace palpate::view {
namespace {

// Draws the control of a setting, and puts a change by the user into `update`.
struct Control {
  Viewer& viewer;
  const client::Setting& setting;
  const client::Settings& settings;
  client::SettingsUpdate& update;

  // Labels end with \0, as all texts of the list.
  bool operator()(const client::NumberSetting& number) const {
    double value = settings.*number.member;
    const bool changed = HeldSlider(viewer, setting.label.data(), value, number.minimum,
                                    number.maximum, SliderFormat(setting).c_str());
    if (changed) update.*number.update = value;
    return changed;
  }
  bool operator()(const client::FlagSetting& flag) const {
    bool value = settings.*flag.member;
    const bool changed = HeldCheckbox(viewer, setting.label.data(), value);
    if (changed) update.*flag.update = value;
    return changed;
  }
  bool operator()(const client::ChoiceSetting& choice) const {
    std::size_t place = choice.get(settings);
    const bool changed = HeldChoice(viewer, setting.label.data(), place, choice.words);
    if (changed) choice.update(update, place);
    return changed;
  }
};

void EditSetting(Viewer& viewer, const client::Setting& setting, const client::Settings& settings) {
  client::SettingsUpdate update;
  const bool changed = std::visit(Control{viewer, setting, settings, update}, setting.kind);
  Tip(setting.help.data());
  if (changed) viewer.feed().commands().Set(update);
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
