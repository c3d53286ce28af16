// The bar above the view: the connection, what acts at once, the state of the forces, and who is
// here and changed what.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/words.h"
#include "client/view/palpated/panel_words.h"
#include "client/view/palpated/shared_things.h"
#include "client/view/panels/input.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {

namespace {

constexpr std::size_t kLongestName = 60;  // bytes
constexpr std::size_t kShownChanges = 6;

void Dot(const ThemeColor& color) {
  const float height = ImGui::GetTextLineHeight();
  const ImVec2 p = ImGui::GetCursorScreenPos();
  ImGui::GetWindowDrawList()->AddCircleFilled({p.x + 0.5f * height, p.y + 0.5f * height + 3.0f},
                                              0.35f * height, color.u32());
  ImGui::Dummy({height, height});
  ImGui::SameLine();
}

struct ConnectionText {
  ThemeColor color;
  std::string text;
  bool is_good = false;
};

ConnectionText TextOfConnection(Viewer& viewer) {
  const LiveFeed& feed = viewer.feed();
  const client::Connection connection = feed.connection();
  if (feed.is_disconnected()) return {kDim, "not connected"};
  switch (connection.state) {
    case client::ConnectionState::kConnected:
      break;
    case client::ConnectionState::kConnecting:
      return {kWarning, "connecting to " + feed.name()};
    case client::ConnectionState::kLost:
      // The start page says more.
      if (viewer.files().PageShown()) return {kDim, "not connected"};
      return {kBad, "reconnecting: " + OneLine(connection.why)};
  }
  const auto silent_s = feed.silent_s();
  if (silent_s) return {kBad, fmt::format("no poses for {:.1f} s", *silent_s)};
  return {kGood, "connected", true};
}

void ConnectionState(Viewer& viewer) {
  const ConnectionText state = TextOfConnection(viewer);
  ImGui::AlignTextToFramePadding();
  Dot(state.color);
  if (ImGui::Button("Connect\xE2\x80\xA6")) OpenConnectDialog(viewer);
  Tip("to which palpated, and as whom (ctrl+K)");
  ImGui::SameLine();
  ImGui::TextColored(state.is_good ? kPlain : state.color, "%s", state.text.c_str());
  if (!state.is_good) return;
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", viewer.feed().name().c_str());
  if (viewer.feed().May(client::Role::kAdmin)) return;
  ImGui::SameLine();
  ImGui::TextColored(kDim, "as %s", NameOf(viewer.feed().role()).data());
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
                       status.is_loading ? "" : "volume: ", OneLine(problem).c_str());
    if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", problem.c_str());
    return;
  }
  if (!lattice) return;
  ImGui::SameLine(0.0f, 24.0f);
  const std::string name = std::filesystem::path(lattice->source).filename().string();
  ImGui::Text("%s", OneLine(name, kLongestName).c_str());
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", OneLine(lattice->source).c_str());
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

// One person, however many programs of theirs are connected.
struct Person {
  client::ConnectedCaller caller;  // the first, with what holds for any of them
  std::size_t programs = 1;
};

std::vector<Person> PeopleOf(const client::Activity& activity) {
  std::vector<Person> people;
  for (const client::ConnectedCaller& caller : activity.callers) {
    const auto known = std::find_if(people.begin(), people.end(), [&](const Person& person) {
      return person.caller.caller.identity == caller.caller.identity;
    });
    if (known == people.end()) {
      people.push_back({caller});
      continue;
    }
    ++known->programs;
    known->caller.is_you |= caller.is_you;
    known->caller.watches |= caller.watches;
    client::Role& role = known->caller.caller.role;
    role = std::max(role, caller.caller.role);
  }
  return people;
}

void ShowPerson(const Person& person) {
  const client::ConnectedCaller& caller = person.caller;
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  ImGui::TextColored(caller.is_you ? kGood : kPlain, "%s%s",
                     OneLine(caller.caller.identity, kLongestName).c_str(),
                     caller.is_you ? " (you)" : "");
  if (ImGui::IsItemHovered()) {
    const std::string from = caller.peer.empty()
                                 ? "programs on palpated's machine, by its local socket"
                                 : "from " + OneLine(caller.peer, kLongestName);
    ImGui::SetTooltip("%s\nhere for %s", from.c_str(), AgeInWords(caller.connected_s).c_str());
  }
  ImGui::TableNextColumn();
  ImGui::TextUnformatted(NameOf(caller.caller.role).data());
  ImGui::TableNextColumn();
  const std::string programs =
      person.programs > 1 ? fmt::format("{} programs ", person.programs) : std::string();
  ImGui::TextColored(kDim, "%s%s", programs.c_str(), caller.watches ? "watches" : "");
  if (caller.watches) Tip("receives the poses of the stylus");
}

void ShowChanges(const Viewer& viewer, const client::Activity& activity) {
  const std::size_t count = std::min(activity.changes.size(), kShownChanges);
  for (std::size_t n = 0; n < count; ++n) {
    const std::string& what = activity.changes[n].what;
    const auto change = viewer.feed().shared().Of(what);
    if (!change) continue;
    const std::string by = change->is_own ? "you" : OneLine(change->by, kLongestName);
    ImGui::PushStyleColor(ImGuiCol_Text, change->is_fresh ? kWarning : kDim);
    ImGui::TextUnformatted((NameOfThing(what) + " by " + ByAndAge(by, change->age_s)).c_str());
    ImGui::PopStyleColor();
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

// Over all windows and tooltips: the button that Dear ImGui has just taken its input for.
void DrawStop(const char* label) {
  const ImU32 color = ImGui::IsItemActive()    ? IM_COL32(255, 77, 64, 255)
                      : ImGui::IsItemHovered() ? IM_COL32(230, 41, 36, 255)
                                               : IM_COL32(191, 26, 26, 255);
  const ImVec2 min = ImGui::GetItemRectMin(), max = ImGui::GetItemRectMax();
  const ImVec2 text = ImGui::CalcTextSize(label);
  ImDrawList& list = *ImGui::GetForegroundDrawList();
  list.AddRectFilled(min, max, color, ImGui::GetStyle().FrameRounding);
  list.AddText({0.5f * (min.x + max.x - text.x), 0.5f * (min.y + max.y - text.y)}, IM_COL32_WHITE,
               label);
}

void StopButton(Viewer& viewer, RowFromRight& row, bool wide, float scale) {
  const char* label = wide ? "STOP FORCES (Esc)" : "STOP";
  const bool pressed = row.Next(label, ButtonWidth(label) + (wide ? 12.0f : 24.0f) * scale);
  DrawStop(label);
  const ImVec2 min = ImGui::GetItemRectMin(), max = ImGui::GetItemRectMax();
  viewer.state().stop_button = {min, {max.x - min.x, max.y - min.y}};
  // The pointer's press has stopped them already, unless the bar moved meanwhile. A second stop at
  // its release would end forces that somebody has enabled since. A key's press always stops them.
  const bool by_pointer = ImGui::IsMouseReleased(ImGuiMouseButton_Left);
  if (pressed && !(by_pointer && viewer.state().stop_was_pressed)) viewer.feed().StopForces();
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

void RecordButton(Viewer& viewer, RowFromRight& row, bool wide) {
  const bool runs = IsRecording(viewer);
  const std::string why = WhyNotRecord(viewer);
  const char* begin = wide ? "Record" : "Rec";
  const char* end = wide ? "End recording" : "End rec";
  if (runs) ImGui::PushStyleColor(ImGuiCol_Text, ImVec4(kBad));
  const bool pressed = row.Next(runs ? end : begin, ButtonWidth(end), why.empty());
  if (runs) ImGui::PopStyleColor();
  Tip(why.empty() ? "every tick and every change, as the file that Session names" : why.c_str());
  if (pressed) ToggleRecording(viewer);
}

void PeopleButton(Viewer& viewer, RowFromRight& row, bool wide) {
  const std::optional<client::Activity>& activity = viewer.feed().activity();
  const std::vector<Person> people = activity ? PeopleOf(*activity) : std::vector<Person>();
  const char* noun = people.size() == 1 ? " person" : " people";
  const std::string label = fmt::format("{}{}###people", people.size(), wide ? noun : "");
  if (row.Next(label.c_str(), ButtonWidth(wide ? "99 people" : "99"))) {
    ImGui::OpenPopup("who is here");
  }
  Tip("who is here, and who changed what");
  if (!ImGui::BeginPopup("who is here")) return;
  if (!activity) {
    ImGui::TextColored(kDim, "not known");
  } else {
    if (ImGui::BeginTable("people", 3)) {
      for (const Person& person : people) ShowPerson(person);
      ImGui::EndTable();
    }
    ShowChanges(viewer, *activity);
  }
  ImGui::EndPopup();
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
  PeopleButton(viewer, row, wide);
  UndoRedo(viewer, row);
  RecordButton(viewer, row, wide);
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

namespace {

KnownState KnownOf(Viewer& viewer, const client::Hand* daemon) {
  const LiveFeed& feed = viewer.feed();
  // On the start page nothing was lost yet.
  const bool is_new =
      viewer.files().PageShown() && feed.connection().state != client::ConnectionState::kConnected;
  KnownState known = {.disconnected = feed.is_disconnected() || is_new,
                      .connection = feed.connection().state,
                      .silent_s = feed.silent_s()};
  if (daemon) {
    known.forces = daemon->forces;
    known.device_problem = daemon->health.problem;
  }
  if (const auto& pose = feed.pose()) {
    known.forces = pose->forces;
    known.mode = pose->mode;
  }
  if (feed.is_replay()) {
    const auto recording = feed.recording();
    known.replay =
        client::InWords(recording ? recording->replay : std::optional<client::RunningReplay>());
  }
  return known;
}

// In the order of Tone.
constexpr std::array<ImU32, 4> kGrounds = {IM_COL32(22, 92, 48, 255), IM_COL32(52, 58, 68, 255),
                                           IM_COL32(140, 88, 12, 255), IM_COL32(140, 26, 24, 255)};
static_assert(kGrounds.size() == static_cast<std::size_t>(Tone::kAlarm) + 1);

// A shape for each tone, for those who do not tell the colours apart: disc, ring, triangle, square.
void DrawSign(Tone tone) {
  const float height = ImGui::GetTextLineHeight();
  const ImVec2 p = ImGui::GetCursorScreenPos();
  const ImVec2 middle{p.x + 0.5f * height, p.y + 0.5f * height + ImGui::GetStyle().FramePadding.y};
  const float r = 0.4f * height;
  const ImU32 white = IM_COL32(255, 255, 255, 255);
  ImDrawList& list = *ImGui::GetWindowDrawList();
  switch (tone) {
    case Tone::kActing:
      list.AddCircleFilled(middle, r, white);
      break;
    case Tone::kIdle:
      list.AddCircle(middle, r, white, 0, 2.0f);
      break;
    case Tone::kCaution:
      list.AddTriangleFilled({middle.x, middle.y - r}, {middle.x + r, middle.y + r},
                             {middle.x - r, middle.y + r}, white);
      break;
    case Tone::kAlarm:
      list.AddRectFilled({middle.x - r, middle.y - r}, {middle.x + r, middle.y + r}, white);
      break;
  }
  ImGui::Dummy({height, height});
  ImGui::SameLine();
}

bool WereVerified(client::VerificationLevel level) {
  return level == client::VerificationLevel::kForceVerified ||
         level == client::VerificationLevel::kSimulated;
}

// If the forces of a device were never verified, it is enabled only by its name.
void ConfirmEnable(Viewer& viewer, const client::DeviceDescription& device) {
  if (!ImGui::BeginPopupModal("Enable forces?", nullptr, ImGuiWindowFlags_AlwaysAutoResize)) return;
  ImGui::Text("The forces of %s were never verified.", device.model.c_str());
  ImGui::Text("Hold the stylus firmly, and have Esc ready, the emergency stop.");
  // Dear ImGui identifies the button by the text after ###. The text before may be anything.
  if (ImGui::Button(("Enable " + OneLine(device.kind, 60) + "###enable").c_str())) {
    viewer.feed().EnableForces(device.kind);
    ImGui::CloseCurrentPopup();
  }
  ImGui::SameLine();
  if (ImGui::Button("Leave them off")) ImGui::CloseCurrentPopup();
  ImGui::EndPopup();
}

const char* LabelOf(ForceAction action, bool wide) {
  if (action == ForceAction::kEnable) return wide ? "Enable forces" : "Enable";
  return wide ? "Disable forces" : "Disable";
}

void EditForces(Viewer& viewer, ForceAction action, const char* label, const client::Hand* daemon) {
  if (action == ForceAction::kDisable) {
    if (ImGui::Button(label)) viewer.feed().DisableForces();
    return;
  }
  ImGui::BeginDisabled(!daemon);
  if (ImGui::Button(label)) {
    if (WereVerified(daemon->device.verification_level)) {
      viewer.feed().EnableForces({});
    } else {
      ImGui::OpenPopup("Enable forces?");
    }
  }
  ImGui::EndDisabled();
}

}  // namespace

void DrawStateBar(Viewer& viewer, const Area& area, float scale) {
  const client::Hand* daemon = viewer.feed().device();
  const StateLine state = StateOf(KnownOf(viewer, daemon));
  const ThemeScope dark(Theme::kDark);  // as the grounds are in both themes
  BeginPanel("state", area, ImGuiWindowFlags_NoScrollWithMouse);
  const ImVec2 max = MaxOf(area);
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.PushClipRect(area.min, max);
  list.AddRectFilled(area.min, max, kGrounds[static_cast<std::size_t>(state.tone)]);
  list.PopClipRect();
  const char* label = LabelOf(state.action, area.size.x > 420.0f * scale);
  const float gap = 8.0f * scale;
  const float button = ButtonWidth(label) + 2.0f * gap;
  // The sign has room in any window.
  const bool may = state.action != ForceAction::kNone &&
                   viewer.feed().May(client::Role::kOperator) &&
                   area.size.x > button + 40.0f * scale;
  const float y = 0.5f * (area.size.y - ImGui::GetFrameHeight());
  ImGui::SetCursorPos({gap, y});
  ImGui::PushClipRect(area.min, {max.x - (may ? button : gap), max.y}, true);
  DrawSign(state.tone);
  ImGui::SetCursorPosY(y);
  ImGui::AlignTextToFramePadding();
  const bool warns = viewer.state().escape.Warns(EscapeRule::Clock::now());
  const std::string line = warns ? "Esc again stops the forces" : OneLine(state.text);
  ImGui::TextUnformatted(line.c_str());
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", line.c_str());
  ImGui::PopClipRect();
  if (may) {
    ImGui::SetCursorPos({area.size.x - button + gap, y});
    EditForces(viewer, state.action, label, daemon);
    Tip(state.action == ForceAction::kEnable ? "let palpated exert forces, for everyone"
                                             : "no forces until they are enabled, for everyone");
    if (daemon && state.action == ForceAction::kEnable) ConfirmEnable(viewer, daemon->device);
  }
  ImGui::End();
}

}  // namespace palpate::view
