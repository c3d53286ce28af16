#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "client/sdk/words.h"
#include "client/view/app/input.h"
#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

constexpr std::size_t kLongestLine = 300;  // bytes
constexpr std::size_t kLongestName = 60;

void Dot(const ImVec4& color) {
  const float height = ImGui::GetTextLineHeight();
  const ImVec2 p = ImGui::GetCursorScreenPos();
  ImGui::GetWindowDrawList()->AddCircleFilled({p.x + 0.5f * height, p.y + 0.5f * height + 3.0f},
                                              0.35f * height,
                                              ImGui::ColorConvertFloat4ToU32(color));
  ImGui::Dummy({height, height});
  ImGui::SameLine();
}

// Begins the button that shows the state in this colour and opens the dialog of the connection.
void BeginState(Viewer& viewer, const ImVec4& color) {
  Dot(color);
  if (ImGui::Button("Connect\xE2\x80\xA6")) OpenConnectDialog(viewer);
  Tip("to which palpated, and as whom (ctrl+K)");
  ImGui::SameLine();
}

void ConnectionState(Viewer& viewer) {
  const client::Connection connection = viewer.feed().connection();
  const std::string& name = viewer.feed().name();
  ImGui::AlignTextToFramePadding();
  // The start page says more.
  const bool is_new =
      connection.state == client::ConnectionState::kLost && viewer.files().PageShown();
  if (viewer.feed().is_disconnected() || is_new) {
    BeginState(viewer, kDim);
    ImGui::TextColored(kDim, "not connected");
    return;
  }
  switch (connection.state) {
    case client::ConnectionState::kConnected:
      if (const auto silent_s = viewer.feed().silent_s()) {
        BeginState(viewer, kBad);
        ImGui::TextColored(kBad, "no poses for %.1f s", *silent_s);
        break;
      }
      BeginState(viewer, kGood);
      ImGui::Text("connected");
      if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", name.c_str());
      if (!viewer.feed().May(client::Role::kAdmin)) {
        ImGui::SameLine();
        ImGui::TextColored(kDim, "as %s", client::NameOf(viewer.feed().role()).c_str());
      }
      break;
    case client::ConnectionState::kConnecting:
      BeginState(viewer, kWarning);
      ImGui::TextColored(kWarning, "connecting to %s", name.c_str());
      break;
    case client::ConnectionState::kLost:
      BeginState(viewer, kBad);
      ImGui::TextColored(kBad, "reconnecting: %s", OneLine(connection.why, kLongestLine).c_str());
      break;
  }
}

void VolumeState(const Viewer& viewer) {
  const client::VolumeStatus status = viewer.feed().volume_status();
  const auto& lattice = viewer.feed().volume().lattice();
  // If the connection is lost, the button already shows this text.
  const bool connected = viewer.feed().connection().state == client::ConnectionState::kConnected;
  const std::string problem = status.problem.empty() ? viewer.volume_problem() : status.problem;
  if (!problem.empty() && connected) {
    ImGui::SameLine();
    ImGui::TextColored(status.is_loading ? kWarning : kBad, "%s%s",
                       status.is_loading ? "" : "volume: ", OneLine(problem, kLongestLine).c_str());
    if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", problem.c_str());
    return;
  }
  if (!lattice) return;
  ImGui::SameLine(0.0f, 24.0f);
  const std::string name = std::filesystem::path(lattice->source).filename().string();
  ImGui::Text("%s", OneLine(name, kLongestName).c_str());
  if (ImGui::IsItemHovered()) {
    ImGui::SetTooltip("%s", OneLine(lattice->source, kLongestLine).c_str());
  }
  ImGui::SameLine();
  ImGui::TextColored(kDim, "%d \xC3\x97 %d \xC3\x97 %d", lattice->size.x(), lattice->size.y(),
                     lattice->size.z());
  if (status.bricks_left > 0) {
    const double all = static_cast<double>(lattice->Bricks());
    const double share = std::max(0.0, 1.0 - static_cast<double>(status.bricks_left) / all);
    ImGui::SameLine();
    ImGui::TextColored(kWarning, "%.0f %% of it here", 100.0 * share);
  }
  if (const std::string coarse = viewer.memory_problem(); !coarse.empty()) {
    ImGui::SameLine();
    ImGui::TextColored(kWarning, "%s", coarse.c_str());
    if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", coarse.c_str());
  }
}

void States(const Viewer& viewer) {
  if (const auto volume = viewer.feed().volume_info(); volume && volume->unsaved_edits > 0) {
    ImGui::SameLine(0.0f, 24.0f);
    ImGui::TextColored(kWarning, "%s", client::UnsavedInWords(volume->unsaved_edits).c_str());
    if (ImGui::IsItemHovered()) ImGui::SetTooltip("save them: ctrl+S");
  }
}

// A button of the bar's fixed row, from the right. Returns true if it was pressed.
class RowFromRight {
 public:
  explicit RowFromRight(float scale)
      : gap_(6.0f * scale), right_(ImGui::GetWindowWidth() - gap_), y_(8.0f * scale) {}

  bool Next(const char* label, float width, bool enabled = true) {
    right_ -= width;
    ImGui::SetCursorPos({right_, y_});
    right_ -= gap_;
    ImGui::BeginDisabled(!enabled);
    const bool pressed = ImGui::Button(label, {width, 0.0f});
    ImGui::EndDisabled();
    return pressed;
  }
  float left() const { return right_; }

 private:
  float gap_, right_, y_;
};

void StopButton(Viewer& viewer, RowFromRight& row, bool wide, float scale) {
  const char* label = wide ? "STOP FORCES (Esc)" : "STOP";
  ImGui::PushStyleColor(ImGuiCol_Text, {1.0f, 1.0f, 1.0f, 1.0f});
  ImGui::PushStyleColor(ImGuiCol_Button, {0.75f, 0.10f, 0.10f, 1.0f});
  ImGui::PushStyleColor(ImGuiCol_ButtonHovered, {0.90f, 0.16f, 0.14f, 1.0f});
  ImGui::PushStyleColor(ImGuiCol_ButtonActive, {1.00f, 0.30f, 0.25f, 1.0f});
  const bool pressed = row.Next(label, ButtonWidth(label) + (wide ? 12.0f : 24.0f) * scale);
  ImGui::PopStyleColor(4);
  const ImVec2 min = ImGui::GetItemRectMin(), max = ImGui::GetItemRectMax();
  viewer.state().stop_button = {min, {max.x - min.x, max.y - min.y}};
  // The pointer's press has stopped them already, unless the bar moved meanwhile.
  if (pressed && !std::exchange(viewer.state().stop_was_pressed, false)) viewer.feed().StopForces();
  Tip("emergency stop: no forces until they are enabled again");
}

void UndoRedo(Viewer& viewer, RowFromRight& row) {
  const auto button = [&](const char* label, const std::string& name, const char* keys) {
    const bool pressed = row.Next(label, ButtonWidth("Undo"), !name.empty());
    Tip((std::string(label) + " " + (name.empty() ? "nothing" : name) + " (" + keys +
         "): what you did, never what others did")
            .c_str());
    return pressed;
  };
  UserActions& actions = viewer.actions();
  if (button("Redo", actions.redo_name(), "ctrl+Y")) RedoEdit(viewer);
  if (button("Undo", actions.undo_name(), "ctrl+Z")) UndoEdit(viewer);
}

void Record(Viewer& viewer, RowFromRight& row, bool wide) {
  const auto recording = viewer.feed().recording();
  const bool runs = recording && recording->running;
  const std::string why = WhyNotRecord(viewer);
  const char* begin = wide ? "Record" : "Rec";
  const char* end = wide ? "End recording" : "End rec";
  if (runs) ImGui::PushStyleColor(ImGuiCol_Text, ImVec4(kBad));
  const bool pressed = row.Next(runs ? end : begin, ButtonWidth(end), why.empty());
  if (runs) ImGui::PopStyleColor();
  Tip(why.empty() ? "every tick and every change, as the file that Session names" : why.c_str());
  if (pressed) ToggleRecording(viewer);
}

// Always in the same place. Returns where the row begins. In a narrow window the texts are shorter,
// so that the state of the connection has room.
float Row(Viewer& viewer, float scale) {
  const bool wide = ImGui::GetWindowWidth() > 1000.0f * scale;
  RowFromRight row(scale);
  StopButton(viewer, row, wide, scale);
  if (viewer.files().PageShown()) return row.left();
  const char* help = wide ? "Help (F1)" : "?";
  if (row.Next(help, ButtonWidth(help))) viewer.state().help_shown ^= true;
  Tip("keys and what the pointer does (F1)");
  const std::size_t people = CountPeople(viewer);
  const std::string label = fmt::format("{}{}", people,
                                        !wide         ? ""
                                        : people == 1 ? " person"
                                                      : " people");
  if (row.Next((label + "###people").c_str(), ButtonWidth(wide ? "99 people" : "99"))) {
    ImGui::OpenPopup("who is here");
  }
  Tip("who is here, and who changed what");
  if (ImGui::BeginPopup("who is here")) {
    ShowPeople(viewer);
    ImGui::EndPopup();
  }
  UndoRedo(viewer, row);
  Record(viewer, row, wide);
  return row.left();
}

}  // namespace

void DrawTopBar(Viewer& viewer, const Area& area, float scale) {
  BeginPanel("top", area, ImGuiWindowFlags_NoScrollWithMouse);
  const ImVec2 p = ImGui::GetWindowPos();
  // Dialogs may lie behind it.
  ImGui::GetWindowDrawList()->AddRectFilled(p, {p.x + area.size.x, p.y + area.size.y},
                                            ImGui::GetColorU32(ImGuiCol_WindowBg));
  const ImVec2 first = ImGui::GetCursorPos();
  const float buttons = Row(viewer, scale);
  ImGui::SetCursorPos(first);
  // Clips long lines, so that they do not lie under the buttons.
  ImGui::PushClipRect(p, {p.x + buttons - 8.0f * scale, p.y + ImGui::GetWindowHeight()}, true);
  DrawFileMenu(viewer);
  ImGui::SameLine();
  ConnectionState(viewer);
  VolumeState(viewer);
  States(viewer);
  ImGui::PopClipRect();
  ImGui::End();
}

}  // namespace palpate::view
