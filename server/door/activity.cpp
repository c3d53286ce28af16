#include "server/door/activity.h"

#include <algorithm>
#include <utility>

#include "server/log/line_budget.h"

namespace palpate {

std::string PeerInWords(const std::string& peer) {
  if (peer.starts_with("unix:")) return "";
  std::string text = peer;
  // gRPC escapes the brackets of "ipv6:[::1]:60286".
  for (const auto& [escaped, bracket] : {std::pair("%5B", "["), std::pair("%5D", "]")}) {
    const auto at = text.find(escaped);
    if (at != text.npos) text.replace(at, 3, bracket);
  }
  return text;
}

std::string WhoInWords(const Identity& caller, const std::string& peer) {
  const std::string from = PeerInWords(peer);
  return from.empty() ? caller.name : caller.name + " at " + from;
}

bool Activity::IsGone(const Seen& seen, std::int64_t now_ns) {
  constexpr std::int64_t kHere_ns = std::chrono::nanoseconds(kHere).count();
  return seen.calls == 0 && now_ns - seen.last_ns > kHere_ns;
}

bool Activity::Came(const Identity& identity, const std::string& peer, bool watches,
                    std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  const std::pair key(AddressOf(peer), identity.name);
  auto found = callers_.find(key);
  if (found != callers_.end() && IsGone(found->second, now_ns)) {
    callers_.erase(found);
    found = callers_.end();
  }
  if (found == callers_.end()) {
    std::erase_if(callers_, [&](const auto& one) { return IsGone(one.second, now_ns); });
    if (callers_.size() >= kMostCallers) return false;
    Seen seen{.caller = {identity, key.first, now_ns}, .number = came_++};
    found = callers_.emplace(key, std::move(seen)).first;
  }
  Seen& seen = found->second;
  seen.caller.identity = identity;
  seen.last_ns = now_ns;
  ++seen.calls;
  if (watches) ++seen.pose_streams;
  return true;
}

void Activity::Left(const Identity& identity, const std::string& peer, bool watches,
                    std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  const auto found = callers_.find({AddressOf(peer), identity.name});
  if (found == callers_.end()) return;
  Seen& seen = found->second;
  seen.last_ns = now_ns;
  if (seen.calls > 0) --seen.calls;
  if (watches && seen.pose_streams > 0) --seen.pose_streams;
}

void Activity::Changed(std::string_view what, std::string by, std::int64_t now_ns) {
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(changes_, [&](const Change& change) { return change.what == what; });
    changes_.push_back({std::string(what), std::move(by), now_ns});
  }
  MayHaveChanged(what);
}

std::vector<Activity::Caller> Activity::callers(std::int64_t now_ns) const {
  std::map<std::uint64_t, Caller> in_order;
  const std::lock_guard lock(mutex_);
  for (const auto& [key, seen] : callers_) {
    if (IsGone(seen, now_ns)) continue;
    Caller& caller = in_order[seen.number] = seen.caller;
    caller.watches = seen.pose_streams > 0;
  }
  std::vector<Caller> callers;
  for (auto& [number, caller] : in_order) callers.push_back(std::move(caller));
  return callers;
}

std::vector<Activity::Change> Activity::changes() const {
  const std::lock_guard lock(mutex_);
  return {changes_.rbegin(), changes_.rend()};
}

}  // namespace palpate
