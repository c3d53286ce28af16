#include <array>
#include <optional>
#include <string>

#include "client/sdk/words.h"
#include "client/view/palpated/state_line.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
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
