// Every call of palpate.v1: the least role that may make it, and what bounds it.
//
// A test compares this table with the services' descriptors.
// Threads: constants.
#pragma once

#include <span>
#include <string_view>

#include "server/security/role.h"

namespace palpate {

// What is counted per identity.
enum class CallKind {
  kCall,          // answered at once: so many per second
  kPoseStream,    // so many at a time, as the next two
  kVolumeStream,  //
  kTransfer,      // loads, saves, uploads, filters, replays: seconds to minutes each
  kStop,          // the emergency stop: nothing bounds it
};

struct MethodRule {
  std::string_view method;  // as gRPC names it: "/palpate.v1.PoseService/StreamPoses"
  Role least;
  CallKind kind;
};

std::span<const MethodRule> MethodRules();
// Null: there is no such method.
const MethodRule* FindMethodRule(std::string_view method);

}  // namespace palpate
