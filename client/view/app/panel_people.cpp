// Who is connected, and what they changed.
#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "client/sdk/words.h"
#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/live/shared_things.h"

namespace palpate::view {
namespace {

constexpr std::size_t kLongestName = 60;
constexpr std::size_t kShownChanges = 6;

void ShowCaller(const client::ConnectedCaller& caller) {
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  ImGui::TextColored(caller.is_you ? kGood : kPlain, "%s%s",
                     OneLine(caller.identity, kLongestName).c_str(), caller.is_you ? " (you)" : "");
  if (ImGui::IsItemHovered()) {
    const std::string from = caller.peer.empty()
                                 ? "programs on palpated's machine, by its local socket"
                                 : "from " + OneLine(caller.peer, kLongestName);
    ImGui::SetTooltip("%s\nhere for %s", from.c_str(), AgeInWords(caller.connected_s).c_str());
  }
  ImGui::TableNextColumn();
  ImGui::TextUnformatted(client::NameOf(caller.role).c_str());
  ImGui::TableNextColumn();
  ImGui::TextColored(kDim, "%s", caller.watches ? "watches" : "");
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
    ImGui::TextWrapped("%s", (NameOfThing(what) + " by " + ByAndAge(by, change->age_s)).c_str());
    ImGui::PopStyleColor();
  }
}

}  // namespace

void PeoplePanel(Viewer& viewer) {
  if (!ImGui::CollapsingHeader("People")) return;
  const std::optional<client::Activity>& activity = viewer.feed().activity();
  if (!activity) {
    ImGui::TextColored(kDim, "not known");
    return;
  }
  if (ImGui::BeginTable("people", 3, ImGuiTableFlags_SizingStretchProp)) {
    for (const client::ConnectedCaller& caller : activity->callers) ShowCaller(caller);
    ImGui::EndTable();
  }
  ShowChanges(viewer, *activity);
}

}  // namespace palpate::view
