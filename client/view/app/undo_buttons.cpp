#include <string>

#include "client/view/app/input.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

std::string TextOf(const std::string& verb, const std::string& name, const char* keys) {
  return verb + (name.empty() ? "" : " " + name) + " (" + keys + ")";
}

// The text changes, the button stays the same.
bool Button(const std::string& verb, const std::string& name, const char* keys, const char* tip) {
  ImGui::BeginDisabled(name.empty());
  const bool pressed = ImGui::Button((TextOf(verb, name, keys) + "###" + verb).c_str());
  ImGui::EndDisabled();
  Tip(tip);
  return pressed;
}

}  // namespace

void UndoButtons(Viewer& viewer) {
  UserActions& actions = viewer.actions();
  const bool undo = Button("Undo", actions.undo_name(), "ctrl+Z",
                           "takes back what you did last; never what others did");
  ImGui::SameLine();
  const std::string name = actions.redo_name();
  const float width = ButtonWidth(TextOf("Redo", name, "ctrl+Y").c_str());
  if (ImGui::GetContentRegionAvail().x < width) ImGui::NewLine();
  const bool redo = Button("Redo", name, "ctrl+Y", "does again what was taken back");
  if (undo) UndoEdit(viewer);
  if (redo) RedoEdit(viewer);
}

}  // namespace palpate::view
