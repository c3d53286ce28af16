#include <imgui.h>

#include <optional>
#include <string>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {

void DevicePanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader(kDeviceHeading)) return;
  const std::optional<client::DaemonInfo> daemon = viewer.feed().device();
  if (daemon) {
    ImGui::TextWrapped("%s", daemon->device.model.c_str());
    if (!daemon->hand_led_by.empty()) {
      ImGui::TextWrapped("in the hand of %s", OneLine(daemon->hand_led_by, 200).c_str());
    }
    if (!daemon->health.problem.empty()) {
      ImGui::PushStyleColor(ImGuiCol_Text, kBad);
      ImGui::TextWrapped("%s", daemon->health.problem.c_str());
      ImGui::PopStyleColor();
    }
  }
}

}  // namespace palpate::view
