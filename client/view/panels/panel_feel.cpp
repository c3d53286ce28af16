// How it feels, for everyone; and the device.

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <string>
#include <variant>

#include "client/sdk/words.h"
#include "client/view/drawing/readout.h"
#include "client/view/palpated/setting_change.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

// Draws the control of a setting. Returns true if the user changed it; `value` is then the user's,
// as ValueOf counts.
struct Control {
  Viewer& viewer;
  const client::Setting& setting;
  double& value;
  const char* label = setting.label.data();  // ends with \0, as all texts of the list

  bool operator()(const client::NumberSetting& number) const {
    std::string format = SliderFormat(setting);
    // A length of the device, beside which the volume is larger or smaller.
    const double device_mm_per_mm = DeviceMmPerMm(viewer.feed().volume());
    if (setting.unit == "mm" && std::abs(device_mm_per_mm - 1.0) > 0.005 && value > 0.0) {
      format += fmt::format(" ({:.3g} in the volume)", value / device_mm_per_mm);
    }
    return HeldSlider(viewer, label, value, number.minimum, number.maximum, format.c_str());
  }
  bool operator()(const client::FlagSetting& /*flag*/) const {
    bool on = value > 0.5;
    const bool changed = HeldCheckbox(viewer, label, on);
    value = on ? 1.0 : 0.0;
    return changed;
  }
  bool operator()(const client::ChoiceSetting& choice) const {
    return HeldChoice(viewer, label, value, choice.words);
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
    if (setting.key != "tool_radius_mm" || !settings->tool.ball.empty()) continue;
    const std::string ball = client::BallInWords(*settings);
    if (!ball.empty()) ImGui::TextWrapped("%s", OneLine(ball, 200).c_str());
  }
  EndAllowed();
}

void DevicePanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader(kDeviceHeading)) return;
  const client::Hand* daemon = viewer.feed().device();
  if (!daemon) return;
  ImGui::TextWrapped("%s", daemon->device.model.c_str());
  if (!daemon->led_by.empty()) {
    ImGui::TextWrapped("in the hand of %s", OneLine(daemon->led_by, 200).c_str());
  }
  if (!daemon->health.problem.empty()) WrappedText(kBad, daemon->health.problem);
}

}  // namespace palpate::view
