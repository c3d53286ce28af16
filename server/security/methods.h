// Lists every call of palpate.v1: the lowest role that may make it, and its limits.
//
// A test compares this table with the services' descriptors.
// Threads: constants.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "common/contract/enumerations.h"

namespace palpate {

// Who a client is, and what it may do.
//
// Threads: plain values.
//
// A recognised client. The name is unique among all ways to be recognised: "token lab-script",
// "certificate viewer.lab.example", "local socket".
struct Identity {
  std::string name{};
  Role role = Role::kViewer;
};

// The kinds of calls, counted per identity.
enum class CallKind {
  kCall,          // answered at once; limited per second
  kQuestion,      // as a call that changes nothing; limited by its work, too
  kPoseStream,    // limited at a time, as are the next three
  kVolumeStream,  //
  kFactStream,    //
  kTransfer,      // loads, saves, uploads, filters, replays: take seconds to minutes
  kHand,          // leads the simulated hand; limited at a time
  kStop,          // the emergency stop: not limited
};

// What a call means while a recording is replayed.
enum class InReplay {
  kShown,    // answers or sends what viewers are shown: the recording's
  kLive,     // acts on what is live, as always; what it does is kept
  kRefused,  // refused with the reason: the caller would not see what the call changes
};

struct MethodRule {
  std::string_view method;  // as gRPC names it: "/palpate.v1.PoseService/StreamPoses"
  Role least;
  CallKind kind;
  InReplay in_replay;
  bool needs_volume = true;  // it is answered only once the first volume has loaded
};

std::span<const MethodRule> MethodRules();
// Returns null if there is no such method.
const MethodRule* FindMethodRule(std::string_view method);

}  // namespace palpate
