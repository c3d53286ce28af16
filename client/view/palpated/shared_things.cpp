#include "client/view/palpated/shared_things.h"

#include <algorithm>
#include <cmath>

#include "client/sdk/settings.h"

namespace palpate::view {
namespace {

using Seconds = std::chrono::duration<double>;

// A change is ours if palpated made it within this time before or after we asked for it. The time
// before allows for the age of the answer. A change at another time was made by another program
// with our identity.
constexpr Seconds kOwnBefore{1.0};
constexpr Seconds kOwnAfter{3.0};

std::string OwnName(const client::Activity& activity) {
  for (const client::ConnectedCaller& caller : activity.callers) {
    if (!caller.is_you) continue;
    return WithoutPort(caller.peer.empty() ? caller.caller.identity
                                           : caller.caller.identity + " at " + caller.peer);
  }
  return "";
}

}  // namespace

std::string WithoutPort(std::string_view by) {
  const std::size_t at = by.find(" at ipv");
  if (at == by.npos) return std::string(by);
  const std::string_view address = by.substr(by.find(':', at) + 1);
  return std::string(by.substr(0, at + 4)) + std::string(address.substr(0, address.rfind(':')));
}

std::string AgeInWords(double age_s) {
  if (age_s < 1.0) return "now";
  if (age_s < 60.0) return std::to_string(static_cast<int>(age_s)) + " s";
  if (age_s < 3600.0) return std::to_string(static_cast<int>(age_s / 60.0)) + " min";
  return std::to_string(static_cast<int>(age_s / 3600.0)) + " h";
}

std::string ByAndAge(const std::string& by, double age_s) {
  const std::string age = AgeInWords(age_s);
  return by + ", " + (age == "now" ? age : age + " ago");
}

std::string NameOfThing(std::string_view what) {
  const auto* found = std::find_if(client::kSettings.begin(), client::kSettings.end(),
                                   [&](const client::Setting& s) { return s.key == what; });
  return std::string(found == client::kSettings.end() ? what : found->name);
}

std::string ChangedByInWords(const client::Activity& activity,
                             std::initializer_list<std::string_view> things) {
  for (const client::LastChange& change : activity.changes) {
    if (std::find(things.begin(), things.end(), change.what) == things.end()) continue;
    return ByAndAge(WithoutPort(change.by), change.ago_s);
  }
  return "";
}

void SharedThings::NoteOwn(std::string_view what, Clock::time_point now) {
  own_.insert_or_assign(std::string(what), now);
}

void SharedThings::Take(const std::optional<client::Activity>& activity, Clock::time_point came) {
  known_.clear();
  if (!activity) return;
  const std::string own_name = OwnName(*activity);
  for (const client::LastChange& change : activity->changes) {
    Known known{.by = WithoutPort(change.by),
                .at = came - std::chrono::duration_cast<Clock::duration>(Seconds(change.ago_s))};
    known.is_ours = known.by == own_name;
    known_.emplace(change.what, std::move(known));
  }
}

std::optional<SharedThings::Change> SharedThings::Of(std::string_view what,
                                                     Clock::time_point now) const {
  const auto found = known_.find(what);
  if (found == known_.end()) return std::nullopt;
  const Known& known = found->second;
  const auto own = own_.find(what);
  const bool is_own = known.is_ours && own != own_.end() && known.at > own->second - kOwnBefore &&
                      known.at < own->second + kOwnAfter;
  const double age_s = std::max(0.0, Seconds(now - known.at).count());
  return Change{.by = known.by,
                .age_s = age_s,
                .is_own = is_own,
                .is_fresh = !is_own && age_s < Seconds(kFresh).count()};
}

std::string SharedThings::FreshLine(Clock::time_point now) const {
  std::string line;
  double newest_s = Seconds(kFresh).count();
  for (const auto& [what, known] : known_) {
    const std::optional<Change> change = Of(what, now);
    if (!change->is_fresh || change->age_s >= newest_s) continue;
    newest_s = change->age_s;
    line = NameOfThing(what) + " by " + ByAndAge(change->by, change->age_s);
  }
  return line;
}

}  // namespace palpate::view
