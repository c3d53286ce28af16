// Who is connected, and what they changed.
#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "client/sdk/words.h"
#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/live/shared_things.h"

namespace palpate::view {
namespace {

constexpr std::size_t kLongestName = 60;
constexpr std::size_t kShownChanges = 6;

// One person, however many programs of theirs are connected.
struct Person {
  client::ConnectedCaller caller;  // the first, with what holds for any of them
  std::size_t programs = 1;
};

std::vector<Person> PeopleOf(const client::Activity& activity) {
  std::vector<Person> people;
  for (const client::ConnectedCaller& caller : activity.callers) {
    const auto known = std::find_if(people.begin(), people.end(), [&](const Person& person) {
      return person.caller.identity == caller.identity;
    });
    if (known == people.end()) {
      people.push_back({caller});
      continue;
    }
    ++known->programs;
    known->caller.is_you |= caller.is_you;
    known->caller.watches |= caller.watches;
    known->caller.role = std::max(known->caller.role, caller.role);
  }
  return people;
}

void ShowPerson(const Person& person) {
  const client::ConnectedCaller& caller = person.caller;
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

}  // namespace

std::size_t CountPeople(const Viewer& viewer) {
  const std::optional<client::Activity>& activity = viewer.feed().activity();
  return activity ? PeopleOf(*activity).size() : 0;
}

void ShowPeople(Viewer& viewer) {
  const std::optional<client::Activity>& activity = viewer.feed().activity();
  if (!activity) {
    ImGui::TextColored(kDim, "not known");
    return;
  }
  if (ImGui::BeginTable("people", 3)) {
    for (const Person& person : PeopleOf(*activity)) ShowPerson(person);
    ImGui::EndTable();
  }
  ShowChanges(viewer, *activity);
}

}  // namespace palpate::view
