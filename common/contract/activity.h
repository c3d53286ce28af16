// Written by proto/generate from palpate/v1/activity.proto: change that.
#pragma once

#include <string>
#include <vector>

#include "common/contract/device.h"

namespace palpate {

// Somebody who uses the daemon now.
struct ConnectedCaller {
  CallerDescription caller{};
  // The address that it calls from: "ipv4:192.0.2.7", or as a door says it; empty: a socket.
  std::string peer{};
  // How long ago it made its first call; since then it was never away for 10 s.
  double connected_s = 0.0;
  // Receives poses, so it probably shows them to somebody.
  bool watches = false;
  // The one who asks.
  bool is_you = false;
  friend bool operator==(const ConnectedCaller&, const ConnectedCaller&) = default;
};
template <class Visit>
void VisitFields(const ConnectedCaller& value, Visit&& visit) {
  visit("caller", value.caller);
  visit("peer", value.peer);
  visit("connected_s", value.connected_s);
  visit("watches", value.watches);
  visit("is_you", value.is_you);
}
template <class Visit>
void VisitFields(ConnectedCaller& value, Visit&& visit) {
  visit("caller", value.caller);
  visit("peer", value.peer);
  visit("connected_s", value.connected_s);
  visit("watches", value.watches);
  visit("is_you", value.is_you);
}

// The newest change of one thing.
struct LastChange {
  // The name of a setting, such as "isovalue" (also for normalized_isovalue); or "volume" (a
  // load or an upload), "voxels" (edits, filters, undo), "placement", "series", "forces",
  // "hand", "recording".
  std::string what{};
  // Who, and from where: "token or-2 at ipv4:192.0.2.7:51544".
  std::string by{};
  // How long ago.
  double ago_s = 0.0;
  friend bool operator==(const LastChange&, const LastChange&) = default;
};
template <class Visit>
void VisitFields(const LastChange& value, Visit&& visit) {
  visit("what", value.what);
  visit("by", value.by);
  visit("ago_s", value.ago_s);
}
template <class Visit>
void VisitFields(LastChange& value, Visit&& visit) {
  visit("what", value.what);
  visit("by", value.by);
  visit("ago_s", value.ago_s);
}

struct GetActivityResponse {
  // Those who have a call that runs, such as a stream of poses, or made one in the last 10 s.
  // Each identity once for each of its addresses; all programs on one socket together are one.
  // In the order in which they came; at most 64.
  std::vector<ConnectedCaller> callers{};
  // The newest change of each thing, newest first. Since the daemon's start.
  std::vector<LastChange> changes{};
  friend bool operator==(const GetActivityResponse&, const GetActivityResponse&) = default;
};
template <class Visit>
void VisitFields(const GetActivityResponse& value, Visit&& visit) {
  visit("callers", value.callers);
  visit("changes", value.changes);
}
template <class Visit>
void VisitFields(GetActivityResponse& value, Visit&& visit) {
  visit("callers", value.callers);
  visit("changes", value.changes);
}

}  // namespace palpate
