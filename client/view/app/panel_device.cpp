#include <imgui.h>
#include <imgui_stdlib.h>

#include <optional>
#include <string>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

void EditRecording(Viewer& viewer, const std::optional<client::RecordingState>& recording) {
  LiveFeed& feed = viewer.feed();
  if (recording && recording->running) {
    if (ImGui::Button("Stop recording")) {
      feed.DoAndAsk("stop recording", [](client::Client& client) { client.StopRecording(); });
    }
    Tip("close the file");
    ImGui::TextWrapped("%s", recording->path.c_str());
    ImGui::TextColored(kDim, "%.1f s, %.1f MB", static_cast<double>(recording->ticks) / 1000.0,
                       static_cast<double>(recording->size_bytes) / 1e6);
    if (recording->lost_ticks > 0) {
      ImGui::TextColored(kBad, "%llu ticks lost",
                         static_cast<unsigned long long>(recording->lost_ticks));
    }
    return;
  }
  std::string& path = viewer.state().recording_path;
  ImGui::SetNextItemWidth(ImGui::GetContentRegionAvail().x);
  ImGui::InputTextWithHint("##path", "/file on palpated's machine", &path);
  Tip("the new recording's file: .palrec");
  ImGui::BeginDisabled(path.empty());
  if (ImGui::Button("Record")) {
    feed.DoAndAsk("record", [path](client::Client& client) { client.StartRecording(path); });
  }
  Tip("record hand, forces, settings and edits, to be replayed bit for bit");
  ImGui::EndDisabled();
  if (recording && !recording->error.empty()) {
    ImGui::PushStyleColor(ImGuiCol_Text, kBad);
    ImGui::TextWrapped("%s", recording->error.c_str());
    ImGui::PopStyleColor();
  }
}

}  // namespace

void DevicePanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader(kDeviceHeading)) return;
  const std::optional<client::DaemonInfo> daemon = viewer.feed().device();
  if (daemon) {
    ImGui::TextWrapped("%s", daemon->device.model.c_str());
    if (!daemon->health.problem.empty()) {
      ImGui::PushStyleColor(ImGuiCol_Text, kBad);
      ImGui::TextWrapped("%s", daemon->health.problem.c_str());
      ImGui::PopStyleColor();
    }
  }
}

void RecordingPanel(Viewer& viewer) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Recording")) return;
  const std::optional<client::RecordingState> recording = viewer.feed().recording();
  BeginAllowed(viewer, client::Role::kOperator);
  EditRecording(viewer, recording);
  EndAllowed();
}

}  // namespace palpate::view
