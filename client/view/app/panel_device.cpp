#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

// Draws the last 10 seconds by the clock. While no poses came, there is no line.
void DrawCurve(const PlotHistory& plots, Plot plot, std::int64_t end_ns, const Area& area) {
  constexpr std::int64_t kGap_ns = 250'000'000;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 max{area.min.x + area.size.x, area.min.y + area.size.y};
  list.AddRectFilled(area.min, max, ImGui::GetColorU32(ImGuiCol_FrameBg), 3.0f);
  const std::span<const float> values = plots.Values(plot);
  const std::span<const std::int64_t> times_ns = plots.Times_ns();
  // Leave room above the greatest value. If all values are 0, the line is at the bottom.
  const float top = plots.Greatest(plot) > 0.0f ? 1.1f * plots.Greatest(plot) : 1.0f;
  std::vector<ImVec2> line;
  const auto finish = [&] {
    list.AddPolyline(line.data(), static_cast<int>(line.size()),
                     ImGui::GetColorU32(ImGuiCol_PlotLines), 0, 1.0f);
    line.clear();
  };
  for (std::size_t n = 0; n < values.size(); ++n) {
    const double before = static_cast<double>(end_ns - times_ns[n]) / PlotHistory::kSpan_ns;
    if (n > 0 && times_ns[n] - times_ns[n - 1] > kGap_ns) finish();
    line.push_back({max.x - static_cast<float>(before) * area.size.x,
                    max.y - 2.0f - std::min(values[n] / top, 1.0f) * (area.size.y - 4.0f)});
  }
  finish();
}

void Curve(const Viewer& viewer, Plot plot, const char* name, const char* format, float scale) {
  const PlotHistory& plots = viewer.feed().plots();
  std::array<char, 32> newest{"\xE2\x80\x93"};
  std::array<char, 32> greatest{};
  // If no poses come any more, there is no present value.
  if (!viewer.feed().silent_s()) {
    std::snprintf(newest.data(), newest.size(), format, static_cast<double>(plots.Newest(plot)));
  }
  std::snprintf(greatest.data(), greatest.size(), format,
                static_cast<double>(plots.Greatest(plot)));
  const std::string most = std::string("max ") + greatest.data();
  const float width = ImGui::GetContentRegionMax().x;
  ImGui::Text("%s", name);
  ImGui::SameLine(0.4f * width);
  ImGui::Text("%s", newest.data());
  ImGui::SameLine(width - ImGui::CalcTextSize(most.c_str()).x);
  ImGui::TextColored(kDim, "%s", most.c_str());
  const Area area{ImGui::GetCursorScreenPos(), {ImGui::GetContentRegionAvail().x, 30.0f * scale}};
  ImGui::Dummy(area.size);
  DrawCurve(plots, plot, viewer.feed().plots_end_ns(), area);
}

void EditRecording(Viewer& viewer, const std::optional<client::RecordingState>& recording) {
  LiveFeed& feed = viewer.feed();
  if (recording && recording->running) {
    if (ImGui::Button("Stop recording")) {
      feed.DoAndAsk("stop recording", [](client::Client& client) { client.StopRecording(); });
    }
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
  ImGui::BeginDisabled(path.empty());
  if (ImGui::Button("Record")) {
    feed.DoAndAsk("record", [path](client::Client& client) { client.StartRecording(path); });
  }
  ImGui::EndDisabled();
  if (recording && !recording->error.empty()) {
    ImGui::PushStyleColor(ImGuiCol_Text, kBad);
    ImGui::TextWrapped("%s", recording->error.c_str());
    ImGui::PopStyleColor();
  }
}

}  // namespace

void DevicePanel(Viewer& viewer) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Device")) return;
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

void PlotsPanel(Viewer& viewer, float scale) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Last 10 seconds")) return;
  if (const auto silent_s = viewer.feed().silent_s()) {
    ImGui::TextColored(kBad, "no poses for %.1f s", *silent_s);
  }
  Curve(viewer, Plot::kForce_n, "|F|", "%.2f N", scale);
  Curve(viewer, Plot::kPenetration_mm, "Penetration", "%.2f mm", scale);
  Curve(viewer, Plot::kUpdate_us, "Update", "%.1f \xC2\xB5s", scale);
  Curve(viewer, Plot::kMissedTicks, "Missed ticks", "%.0f", scale);
  Curve(viewer, Plot::kStreamAge_ms, "Stream age", "%.1f ms", scale);
}

void RecordingPanel(Viewer& viewer) {
  ImGui::SetNextItemOpen(true, ImGuiCond_Once);
  if (!ImGui::CollapsingHeader("Recording")) return;
  const std::optional<client::RecordingState> recording = viewer.feed().recording();
  BeginAllowed(viewer, client::Role::kOperator);
  EditRecording(viewer, recording);
  EndAllowed();
}

void DrawRightPanels(Viewer& viewer, const Area& area, float scale) {
  BeginPanel("right", area);
  ImGui::PushItemWidth(0.5f * ImGui::GetContentRegionAvail().x);
  DevicePanel(viewer);
  PlotsPanel(viewer, scale);
  RecordingPanel(viewer);
  FeelPanel(viewer);
  ImGui::PopItemWidth();
  ImGui::End();
}

}  // namespace palpate::view
