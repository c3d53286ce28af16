// The rigid tool in the hand, for everyone: which one it is, and another one.
#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>

#include "client/sdk/words.h"
#include "client/view/drawing/readout.h"
#include "client/view/palpated/taken_tool.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"
#include "common/felt_tool/tool_file.h"
#include "common/felt_tool/tool_size.h"

namespace palpate::view {
namespace {

double VoxelEdge_mm(const ViewVolume& volume) {
  return volume.X_DI() ? volume.X_DI()->linear.colwise().norm().minCoeff() : 1.0;
}

void SetTool(Viewer& viewer, const client::SettingsUpdate& update) {
  viewer.feed().shared().NoteOwn("tool");
  viewer.feed().commands().Set(update);
  viewer.state().wished_tool.reset();
}

// Beside the last button, if there is room.
bool NextButton(const std::string& label, bool on = false) {
  const float right = ImGui::GetItemRectMax().x + ImGui::GetStyle().ItemSpacing.x;
  const float edge = ImGui::GetWindowPos().x + ImGui::GetContentRegionMax().x;
  if (right + ButtonWidth(label.c_str()) <= edge) ImGui::SameLine();
  return ToggleButton(label.c_str(), on);
}

// What is in the way of the tool that the user wants, and the button that removes it.
void AskAboutTool(Viewer& viewer, const client::Settings& settings) {
  std::optional<HeldTool>& wished = viewer.state().wished_tool;
  if (!wished) return;
  const double voxel_mm = VoxelEdge_mm(viewer.feed().volume());
  const TakenTool taken = TakeTool(*wished, settings, voxel_mm);
  if (taken.needs.empty()) return SetTool(viewer, taken.update);
  WrappedText(kWarning, fmt::format("{} needs:", wished->name.empty() ? "The tool" : wished->name));
  for (const std::string& need : taken.needs) WrappedText(kWarning, "- " + need);
  ImGui::BeginDisabled(!taken.is_possible);
  if (ImGui::Button("Do so and take it")) SetTool(viewer, taken.update);
  ImGui::EndDisabled();
  if (taken.magnification && wished) {
    const double factor = *taken.magnification;
    if (NextButton(fmt::format("Volume {:g} times its size instead", factor))) {
      // Absolute: a second click must not do it twice.
      viewer.feed().commands().Do("the volume's size",
                                  [edge_mm = factor * voxel_mm](client::Client& palpated) {
                                    palpated.Place({.device_mm_per_voxel = edge_mm});
                                  });
    }
  }
  if (NextButton("Cancel")) wished.reset();
}

void ChooseTool(Viewer& viewer, const HeldTool& held) {
  bool is_first = true;
  for (const OurTool& tool : OurTools()) {
    const std::string name(tool.name);
    const bool on = held.name == name && !held.ball.empty();
    const bool pressed =
        std::exchange(is_first, false) ? ToggleButton(name.c_str(), on) : NextButton(name, on);
    if (pressed) viewer.state().wished_tool = ParseTool(tool.text, tool.name);
    if (!viewer.state().wished_tool) Tip("takes this tool into the hand");
  }
  if (NextButton("File\xE2\x80\xA6")) viewer.files().Choose(DialogKind::kTool);
  Tip("a tool of your own: a .toml file, which may also be dropped onto the window");
  if (held.ball.empty()) return;
  if (NextButton("Put it down")) SetTool(viewer, {.tool = HeldTool()});
  Tip("the stylus's tip is felt again");
}

// What is felt, and how large it is where it is felt.
void TellTool(const Viewer& viewer, const client::Settings& settings) {
  const HeldTool& held = settings.tool;
  if (!held.ball.empty()) {
    WrappedText(kPlain, InWords(held));
    WrappedText(kPlain, SizeInVolume(held, DeviceMmPerMm(viewer.feed().volume())));
  } else if (settings.ball.felt_radius_mm > 0.0) {
    WrappedText(kDim, "none: a ball is felt at the stylus's tip");
  } else {
    WrappedText(kDim, "none: the stylus's tip is felt");
  }
  if (held.ball.empty()) return;
  const std::string state = client::BallInWords(settings);
  if (!state.empty()) WrappedText(settings.ball.problem.empty() ? kDim : kWarning, state);
}

// A tool that carves, while the stylus's button does not.
void OfferCarving(Viewer& viewer, const client::Settings& settings) {
  const auto& balls = settings.tool.ball;
  if (settings.carve_tool || std::ranges::none_of(balls, &HeldToolBall::carves)) return;
  if (ImGui::Button("Let button 0 carve")) {
    viewer.feed().shared().NoteOwn("carve_tool");
    viewer.feed().commands().Set({.carve_tool = true});
  }
  Tip("the burr carves while button 0 of the stylus is held");
}

// A held tool that another volume or its place has made too large or too small.
void OfferFit(Viewer& viewer, const client::Settings& settings) {
  if (settings.tool.ball.empty() || settings.ball.problem.empty()) return;
  const auto scale = FittingScale(settings.tool, VoxelEdge_mm(viewer.feed().volume()));
  if (!scale || *scale == 1.0) return;
  if (ImGui::Button(fmt::format("Take it at {:g} of its size", *scale).c_str())) {
    SetTool(viewer, {.tool = Scaled(settings.tool, *scale)});
  }
}

}  // namespace

void ToolPanel(Viewer& viewer) {
  // A file that was dropped asks here.
  if (viewer.state().wished_tool) ImGui::SetNextItemOpen(true);
  if (!ImGui::CollapsingHeader(kToolHeading)) return;
  const auto& settings = viewer.feed().settings();
  if (!settings) return;
  TellTool(viewer, *settings);
  BeginAllowed(viewer, client::Role::kEditor);
  OfferFit(viewer, *settings);
  OfferCarving(viewer, *settings);
  ChooseTool(viewer, settings->tool);
  SharedSign(viewer, "tool");
  AskAboutTool(viewer, *settings);
  EndAllowed();
}

}  // namespace palpate::view
