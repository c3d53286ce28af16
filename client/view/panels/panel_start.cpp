// The way to a palpated: what is shown at the start, and the dialog of connections.
#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "client/sdk/server_choice.h"
#include "client/sdk/words.h"
#include "client/view/palpated/panel_words.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"
#include "client/view/viewer/files.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

struct Status {
  ImVec4 color;
  std::string text;
};

Status StatusOf(Viewer& viewer) {
  const LiveFeed& feed = viewer.feed();
  const client::Connection connection = feed.connection();
  const LocalDaemon& daemon = viewer.files().daemon();
  const client::VolumeStatus volume = feed.volume_status();
  if (volume.is_loading) return {kWarning, volume.problem};
  if (feed.is_disconnected()) return {kDim, "Not connected."};
  switch (connection.state) {
    case client::ConnectionState::kConnected:
      if (!viewer.files().is_page_kept()) return {kDim, "Waiting for the volume."};
      return {kGood, "palpated runs. Its simulated hand feels a sample."};
    case client::ConnectionState::kConnecting:
      return {kWarning, daemon.runs() ? "palpated is starting." : "Connecting to " + feed.name()};
    case client::ConnectionState::kLost:
      break;
  }
  if (daemon.runs()) return {kWarning, "palpated is starting. It logs to " + daemon.log().string()};
  if (!daemon.problem().empty()) return {kBad, daemon.problem()};
  if (viewer.feed().is_here() && connection.why.starts_with("no palpated at ")) {
    return {kPlain, "No palpated runs on this machine yet. Open something, or start it."};
  }
  return {kBad, connection.why};
}

void ShowStatus(Viewer& viewer) {
  const Status status = StatusOf(viewer);
  WrappedText(status.color, status.text);
  // One of three of the same height: the buttons below must not move away from the pointer while
  // palpated starts.
  if (const auto fraction = FractionIn(status.text)) {
    ImGui::ProgressBar(static_cast<float>(*fraction));
  } else if (viewer.files().is_page_kept() && viewer.feed().volume().lattice()) {
    if (ImGui::Button("Show the sample")) viewer.files().ClosePage();
  } else {
    ImGui::Dummy({0.0f, ImGui::GetFrameHeight()});
  }
}

// A button as wide as its column.
bool WideButton(const char* label, const char* tip) {
  const bool pressed = ImGui::Button(label, {ImGui::GetContentRegionAvail().x, 0.0f});
  Tip(tip);
  return pressed;
}

void TypedPath(Files& files) {
  ImGui::SetNextItemWidth(-ButtonWidth("Open") - ImGui::GetStyle().ItemSpacing.x);
  const bool entered = ImGui::InputTextWithHint("##typed", "or type a path", &files.form().path,
                                                ImGuiInputTextFlags_EnterReturnsTrue);
  ImGui::SameLine();
  if ((ImGui::Button("Open") || entered) && !files.form().path.empty()) {
    files.Open(files.form().path);
  }
}

void Recent(Files& files) {
  if (files.recent().empty()) return;
  ImGui::TextColored(kDim, "Recent");
  std::string chosen;
  for (const std::string& path : files.recent()) {
    const std::string name = std::filesystem::path(path).filename().string();
    ImGui::PushID(path.c_str());
    if (NameSelectable(OneLine(name, 60))) chosen = path;
    Tip(path.c_str());
    ImGui::PopID();
  }
  // Opening changes the list.
  if (!chosen.empty()) files.Open(chosen);
}

void Samples(Files& files) {
  ImGui::TextColored(kDim, "Samples");
  for (const Sample& sample : kSamples) {
    if (ImGui::Button(sample.name)) files.Open(sample.source);
    Tip(sample.what);
    if (&sample != std::end(kSamples) - 1) ImGui::SameLine();
  }
}

void ColumnOfFiles(Viewer& viewer) {
  Files& files = viewer.files();
  ImGui::Text("Open");
  const std::string why = files.WhyNotOpen();
  const bool runs = viewer.feed().loader().running() || files.pending();
  if (!why.empty() && !runs) WrappedText(kDim, why);
  ImGui::BeginDisabled(!why.empty());
  if (WideButton("Open a DICOM folder\xE2\x80\xA6",
                 "a folder of DICOM or TIFF files of one volume")) {
    files.Choose(DialogKind::kOpenFolder);
  }
  if (WideButton("Open a file\xE2\x80\xA6", "NRRD, MetaImage, NIfTI, TIFF, VDB")) {
    files.Choose(DialogKind::kOpenFile);
  }
  TypedPath(files);
  WrappedText(kDim, "or drop a file or folder onto this window");
  Recent(files);
  Samples(files);
  ImGui::EndDisabled();
}

void Profiles(Viewer& viewer) {
  const ConnectForm& form = viewer.state().connect;
  if (!form.profiles_problem.empty()) WrappedText(kBad, form.profiles_problem);
  for (const client::Profile& profile : form.profiles) {
    ImGui::PushID(profile.name.c_str());
    const std::string label = OneLine(profile.name, 60);
    if (WideButton(label.c_str(), profile.where.c_str())) {
      ConnectTo(viewer, {.profile = profile.name});
    }
    ImGui::PopID();
  }
  if (!form.problem.empty()) WrappedText(kBad, form.problem);
}

void ColumnOfServers(Viewer& viewer) {
  Files& files = viewer.files();
  const bool connected = viewer.feed().connection().state == client::ConnectionState::kConnected;
  ImGui::Text("This machine");
  ImGui::BeginDisabled(files.daemon().runs() || (connected && viewer.feed().is_here()) ||
                       viewer.feed().is_stopping());
  if (WideButton("Start here", "starts palpated for you, with a simulated hand")) {
    files.StartHereFromPage();
  }
  ImGui::EndDisabled();
  WrappedText(
      kDim,
      "palpated makes the surface felt. It ends with this window, unless File, Keep palpated "
      "running is on.");
  ImGui::Text("Another machine");
  Profiles(viewer);
  if (WideButton("Server\xE2\x80\xA6", "type its address (ctrl+K)")) OpenConnectDialog(viewer);
}

void Columns(Viewer& viewer, float width, float scale) {
  if (width < 480.0f * scale) {
    ColumnOfFiles(viewer);
    ImGui::Separator();
    ColumnOfServers(viewer);
    return;
  }
  if (!ImGui::BeginTable("columns", 2,
                         ImGuiTableFlags_BordersInnerV | ImGuiTableFlags_SizingStretchSame))
    return;
  ImGui::TableNextColumn();
  ColumnOfFiles(viewer);
  ImGui::TableNextColumn();
  ColumnOfServers(viewer);
  ImGui::EndTable();
}

}  // namespace

void DrawStartPage(Viewer& viewer, const Area& area, float scale) {
  // Larger on a large screen.
  const float zoom = std::clamp(area.size.y / (800.0f * scale), 1.0f, 1.6f);
  const float width = std::min(800.0f * scale * zoom, area.size.x - 8.0f * scale);
  ImGui::SetNextWindowPos({area.min.x + 0.5f * area.size.x, area.min.y + 0.5f * area.size.y},
                          ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowSizeConstraints({width, 0.0f}, {width, area.size.y - 8.0f * scale});
  ImGui::Begin("##start", nullptr, kCard);
  ImGui::SetWindowFontScale(zoom);
  if (ImGui::IsWindowAppearing()) ReadProfiles(viewer);
  ShowStatus(viewer);
  ShowFileCard(viewer);
  ImGui::Separator();
  Columns(viewer, width, scale);
  ImGui::End();
}

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
