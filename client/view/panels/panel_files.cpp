#include <fmt/format.h>
#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <filesystem>

#include "client/sdk/words.h"
#include "client/view/palpated/panel_words.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"
#include "client/view/viewer/files.h"

namespace palpate::view {
namespace {

constexpr std::size_t kLongestPath = 200;  // bytes

// A grey item's tooltip says why it is grey.
bool Item(const char* label, const char* keys, const std::string& why_not, const char* tip) {
  const bool chosen = ImGui::MenuItem(label, keys, false, why_not.empty());
  Tip(why_not.empty() ? tip : why_not.c_str());
  return chosen;
}

void RecentMenu(Files& files, const std::string& why_not) {
  if (!ImGui::BeginMenu("Recent", why_not.empty() && !files.recent().empty())) return;
  std::string chosen;
  for (const std::string& path : files.recent()) {
    ImGui::PushID(path.c_str());
    if (NameSelectable(OneLine(path, kLongestPath))) chosen = path;
    ImGui::PopID();
  }
  ImGui::EndMenu();
  // Opening changes the list.
  if (!chosen.empty()) files.Open(chosen);
}

void SampleMenu(Files& files, const std::string& why_not) {
  if (!ImGui::BeginMenu("Samples", why_not.empty())) return;
  for (const Sample& sample : kSamples) {
    if (ImGui::MenuItem(sample.name)) files.Open(sample.source);
    Tip(sample.what);
  }
  ImGui::EndMenu();
}

void OpenItems(Files& files) {
  const std::string why = files.WhyNotOpen();
  if (Item("Open file\xE2\x80\xA6", "ctrl+O", why, "NRRD, MetaImage, NIfTI, TIFF, VDB")) {
    files.Choose(DialogKind::kOpenFile);
  }
  if (Item("Open folder\xE2\x80\xA6", "", why, "the DICOM or TIFF files of one volume")) {
    files.Choose(DialogKind::kOpenFolder);
  }
  if (Item("Type a path\xE2\x80\xA6", "", why, "of a file or folder on this machine")) {
    files.TypePath();
  }
  RecentMenu(files, why);
  SampleMenu(files, why);
}

void SaveItems(Viewer& viewer, Files& files) {
  if (Item("Save as\xE2\x80\xA6", "ctrl+S", files.WhyNotSave(), "the volume with its edits")) {
    files.BeginSave();
  }
  std::string why = files.WhyNotSave();
  if (why.empty()) why = WhyNot(viewer, client::Role::kEditor);
  if (Item("Revert", "", why, "the volume as it was loaded, for everyone; ctrl+Z takes it back")) {
    files.Revert();
  }
}

void ConnectionItems(Viewer& viewer, Files& files) {
  if (Item("Connect\xE2\x80\xA6", "ctrl+K", {}, "to another palpated")) OpenConnectDialog(viewer);
  if (!files.daemon().runs()) return;
  bool kept = files.daemon().is_kept();
  if (ImGui::MenuItem("Keep palpated running", nullptr, &kept)) files.daemon().Keep(kept);
  Tip("this window started it; otherwise it ends with this window");
}

void ShowRunning(Files& files, VolumeLoader& loader) {
  if (files.pending()) {
    WrappedText(kPlain, "Waiting for palpated, to open " + *files.pending());
    if (ImGui::Button("Cancel")) files.CancelPending();
    Tip("nothing is opened");
    return;
  }
  const auto running = loader.running();
  if (!running) return;
  const client::Progress& progress = running->progress;
  WrappedText(kPlain, running->what + (progress.stage.empty() ? "" : ": " + progress.stage) +
                          (progress.detail.empty() ? "" : " " + progress.detail));
  const float cancel = ButtonWidth("Cancel") + ImGui::GetStyle().ItemSpacing.x;
  ImGui::ProgressBar(static_cast<float>(progress.fraction), {-cancel, 0.0f});
  ImGui::SameLine();
  if (ImGui::Button("Cancel")) loader.Cancel();
  Tip("the volume that is felt stays");
}

void ShowQuestion(Viewer& viewer) {
  Files& files = viewer.files();
  const VolumeLoader::Outcome& asked = files.asked();
  const std::string unsaved = client::UnsavedInWords(asked.unsaved_edits);
  const char* yes = "";
  switch (files.ask()) {
    case Files::Ask::kNothing:
      return;
    case Files::Ask::kDiscard:
      WrappedText(kWarning, unsaved + ", and would be lost");
      yes = "Discard and open";
      break;
    case Files::Ask::kReplace:
      WrappedText(kWarning, asked.text);
      yes = "Replace it";
      break;
    case Files::Ask::kClose:
      WrappedText(kWarning, unsaved + ", and palpated of this window ends with it");
      yes = "Discard and close";
      break;
  }
  if (ImGui::Button(yes)) files.Confirm();
  ImGui::SameLine();
  // Another palpated that the window shows would save its own volume.
  const bool saves =
      files.ask() != Files::Ask::kClose || files.daemon().Serves(viewer.feed().name());
  if (saves) {
    if (ImGui::Button("Save as\xE2\x80\xA6")) files.BeginSave();
    ImGui::SameLine();
  }
  if (files.ask() == Files::Ask::kClose) {
    if (ImGui::Button("Keep palpated and close")) {
      files.daemon().Keep(true);
      files.Confirm();
    }
    ImGui::SameLine();
  }
  if (ImGui::Button("Not now")) files.Dismiss();
}

// Says that the picture is not what is felt now; empty: it is.
std::string WhyOld(const Viewer& viewer) {
  const LiveFeed& feed = viewer.feed();
  if (!feed.volume().lattice() || feed.is_disconnected()) return {};
  const client::VolumeStatus status = feed.volume_status();
  if (status.is_loading) return status.problem;
  const client::Connection connection = feed.connection();
  return connection.state == client::ConnectionState::kLost ? connection.why : "";
}

void ShowOld(Viewer& viewer) {
  const std::string why = WhyOld(viewer);
  if (why.empty()) return;
  WrappedText(kWarning, "This picture is old. " + why);
  if (const auto fraction = FractionIn(why)) ImGui::ProgressBar(static_cast<float>(*fraction));
  Files& files = viewer.files();
  if (files.daemon().problem().empty()) return;
  WrappedText(kBad, files.daemon().problem());
  if (ImGui::Button("Start again and reopen")) files.StartAgain();
  Tip("another palpated with the same volume");
}

bool HasCard(Viewer& viewer) {
  const Files& files = viewer.files();
  return viewer.feed().loader().running() || files.pending() || files.has_question() ||
         !WhyOld(viewer).empty();
}

void PathField(Files& files, float scale) {
  Files::PathForm& form = files.form();
  ImGui::SetNextItemWidth(420.0f * scale);
  const std::string before = form.path;
  if (ImGui::IsWindowAppearing()) ImGui::SetKeyboardFocusHere();
  const bool entered = ImGui::InputText("##path", &form.path, ImGuiInputTextFlags_EnterReturnsTrue);
  if (form.path != before) form.is_confirmed = false;
  if (form.saves && form.where == SaveWhere::kHere && form.has_dialog) {
    ImGui::SameLine();
    if (ImGui::Button("Browse\xE2\x80\xA6")) files.Choose(DialogKind::kSave);
  }
  ImGui::BeginDisabled(form.path.empty());
  const bool pressed = ImGui::Button(form.saves ? "Save" : "Open");
  ImGui::EndDisabled();
  if ((!entered && !pressed) || form.path.empty()) return;
  if (form.saves) {
    files.Save(false);
  } else {
    files.Open(form.path);
  }
}

}  // namespace

void DrawFileMenu(Viewer& viewer) {
  if (ImGui::Button("File")) ImGui::OpenPopup("file menu");
  Tip("open, save, connect");
  if (!ImGui::BeginPopup("file menu")) return;
  Files& files = viewer.files();
  OpenItems(files);
  ImGui::Separator();
  SaveItems(viewer, files);
  ImGui::Separator();
  ConnectionItems(viewer, files);
  ImGui::EndPopup();
}

void ShowFileCard(Viewer& viewer) {
  Files& files = viewer.files();
  ShowRunning(files, viewer.feed().loader());
  ShowQuestion(viewer);
  if (!files.problem().empty()) {
    WrappedText(kBad, files.problem());
    if (ImGui::Button("Close##problem")) files.Dismiss();
  }
  ShowOld(viewer);
}

void DrawNotice(Viewer& viewer, const Area& area, float scale) {
  Files& files = viewer.files();
  const std::vector<std::string>& warnings = files.warnings();
  BeginPanel("notice", area, ImGuiWindowFlags_NoScrollWithMouse);
  const float gap = 8.0f * scale, button = ButtonWidth("Understood");
  ImGui::SetCursorPos({gap, 0.5f * (area.size.y - ImGui::GetFrameHeight())});
  const ImVec2 max{area.min.x + area.size.x - button - 2.0f * gap, area.min.y + area.size.y};
  ImGui::PushClipRect(area.min, max, true);
  ImGui::AlignTextToFramePadding();
  const std::string count =
      warnings.size() > 1 ? fmt::format("(1 of {}) ", warnings.size()) : std::string();
  ImGui::TextColored(kWarning, "%s%s", count.c_str(), OneLine(warnings.front()).c_str());
  if (ImGui::IsItemHovered()) {
    const std::string all = fmt::format("{}", fmt::join(warnings, "\n"));
    ImGui::SetTooltip("the import assumed or left out:\n%s", all.c_str());
  }
  ImGui::PopClipRect();
  ImGui::SameLine();
  ImGui::SetCursorPosX(area.size.x - button - gap);
  if (ImGui::Button("Understood")) files.DismissWarnings();
  Tip("hides this line");
  ImGui::End();
}

void DrawFileCard(Viewer& viewer, const Area& area, float scale) {
  if (!HasCard(viewer)) return;
  const float width = std::min(520.0f * scale, area.size.x - 20.0f * scale);
  ImGui::SetNextWindowPos({area.min.x + 0.5f * area.size.x, area.min.y + 40.0f * scale},
                          ImGuiCond_Always, {0.5f, 0.0f});
  ImGui::SetNextWindowSizeConstraints({width, 0.0f}, {width, area.size.y});
  ImGui::Begin("##files", nullptr, kCard);
  ShowFileCard(viewer);
  ImGui::End();
}

void DrawPathForm(Viewer& viewer, float scale) {
  Files& files = viewer.files();
  Files::PathForm& form = files.form();
  if (!form.shown) return;
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * screen.x, 0.4f * screen.y}, ImGuiCond_Appearing, {0.5f, 0.5f});
  ImGui::Begin(form.saves ? "Save the volume###path form" : "Open a path###path form", &form.shown,
               kDialog);
  if (form.saves && !viewer.feed().is_here()) {
    const bool here = form.where == SaveWhere::kHere;
    if (ImGui::RadioButton("to this machine", here)) form.where = SaveWhere::kHere;
    ImGui::SameLine();
    if (ImGui::RadioButton("on palpated's machine", !here)) form.where = SaveWhere::kThere;
    // The dialog has asked about a file of this machine.
    if (here != (form.where == SaveWhere::kHere)) form.is_confirmed = false;
  }
  ImGui::TextColored(kDim, form.saves ? "a name that ends with .nrrd or .vdb"
                                      : "a file, or a folder of DICOM or TIFF files");
  PathField(files, scale);
  if (!form.has_dialog) {
    ImGui::TextColored(kDim, "For a dialog, install zenity, kdialog or yad.");
  }
  ImGui::End();
}

}  // namespace palpate::view
