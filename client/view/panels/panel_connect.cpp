#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <string>
#include <vector>

#include "client/sdk/server_choice.h"
#include "client/sdk/words.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

// Shows the state of the connection, and the reason if it is lost.
void ShowConnection(const Viewer& viewer) {
  const LiveFeed& feed = viewer.feed();
  const client::Connection connection = feed.connection();
  const std::string& name = feed.name();
  if (feed.is_disconnected()) {
    WrappedText(kDim, "not connected");
  } else if (connection.state == client::ConnectionState::kConnected) {
    const client::CallerDescription& we = feed.caller();
    const std::string who = we.identity.empty() ? "" : " as " + we.identity;
    WrappedText(kGood, "connected to " + name + who + ", role " + std::string(NameOf(we.role)));
    if (!feed.facts_problem().empty()) {
      WrappedText(kBad, "palpated does not tell what changes: " + feed.facts_problem());
    }
  } else if (connection.state == client::ConnectionState::kConnecting) {
    WrappedText(kWarning, "connecting to " + name);
  } else {
    WrappedText(kBad, connection.why);
  }
}

void ChooseProfile(Viewer& viewer, float scale) {
  ConnectForm& form = viewer.state().connect;
  ImGui::Text("Profiles");
  ImGui::SameLine();
  ImGui::TextColored(kDim, "of %s", client::ProfilesFile().c_str());
  if (!form.profiles_problem.empty()) {
    WrappedText(kBad, form.profiles_problem);
    return;
  }
  if (form.profiles.empty()) {
    ImGui::TextColored(kDim, "none: 'palpated token add --client-folder' writes them");
    return;
  }
  for (const client::Profile& profile : form.profiles) {
    ImGui::PushID(profile.name.c_str());
    if (ImGui::Button("Connect")) ConnectTo(viewer, {.profile = profile.name});
    ImGui::SameLine();
    ImGui::AlignTextToFramePadding();
    ImGui::Text("%s", OneLine(profile.name).c_str());
    ImGui::SameLine(200.0f * scale);
    const bool is_right = !profile.where.empty();
    ImGui::TextColored(is_right ? kDim : kBad, "%s",
                       is_right ? OneLine(profile.where).c_str() : "is not right");
    ImGui::PopID();
  }
}

void TypeServer(Viewer& viewer, float scale) {
  client::ServerChoice& typed = viewer.state().connect.typed;
  ImGui::Text("Another palpated");
  ImGui::PushItemWidth(320.0f * scale);
  ImGui::InputTextWithHint("Server", "HOST:PORT", &typed.address.host_port);
  ImGui::InputTextWithHint("Authority", "certificate of who signed palpated's, for TLS",
                           &typed.credentials.ca_file);
  ImGui::InputTextWithHint("Token file", "as 'palpated token add' made it, for TLS",
                           &typed.credentials.token_file);
  ImGui::InputTextWithHint("Socket", "on this machine; empty: the default one",
                           &typed.address.socket_path);
  ImGui::PopItemWidth();
  if (ImGui::Button("Connect to it")) ConnectTo(viewer, typed);
}

}  // namespace

void ConnectTo(Viewer& viewer, const client::ServerChoice& server) {
  ConnectForm& form = viewer.state().connect;
  try {
    viewer.Connect(server);
    form.problem.clear();
  } catch (const Error& error) {
    form.problem = error.what();
  }
}

void ReadProfiles(Viewer& viewer) {
  ConnectForm& form = viewer.state().connect;
  form.profiles_problem.clear();
  try {
    form.profiles = client::ListProfiles();
  } catch (const Error& error) {
    form.profiles.clear();
    form.profiles_problem = error.what();
  }
}

void OpenConnectDialog(Viewer& viewer) {
  ConnectForm& form = viewer.state().connect;
  form.shown = true;
  form.problem.clear();
  ReadProfiles(viewer);
}

void DrawConnectDialog(Viewer& viewer, float scale) {
  ConnectForm& form = viewer.state().connect;
  if (!form.shown) return;
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * screen.x, 0.45f * screen.y}, ImGuiCond_Appearing, {0.5f, 0.5f});
  const float width = std::min(560.0f * scale, screen.x);
  ImGui::SetNextWindowSizeConstraints({width, 0.0f}, {width, screen.y});
  ImGui::Begin("Connection", &form.shown, kDialog);
  ShowConnection(viewer);
  ImGui::BeginDisabled(viewer.feed().is_stopping());
  ImGui::BeginDisabled(viewer.feed().is_disconnected());
  if (ImGui::Button("Disconnect")) viewer.feed().Disconnect();
  ImGui::EndDisabled();
  ImGui::SameLine();
  if (ImGui::Button("Reconnect")) ConnectTo(viewer, viewer.server());
  ImGui::Separator();
  ChooseProfile(viewer, scale);
  ImGui::Separator();
  TypeServer(viewer, scale);
  ImGui::EndDisabled();
  if (!form.problem.empty()) WrappedText(kBad, form.problem);
  ImGui::End();
}

}  // namespace palpate::view
