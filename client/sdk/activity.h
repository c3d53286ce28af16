// Who is connected to the daemon, and who changed what. Fields mean what activity.proto says.
//
// Threads: plain values.
#pragma once

#include <string>
#include <vector>

#include "client/sdk/device.h"

namespace palpate::client {

// Somebody who uses the daemon now.
struct ConnectedCaller {
  std::string identity{};  // "token or-2", "local socket"
  Role role = Role::kUnknown;
  std::string peer{};  // "ipv4:192.0.2.7"; empty: the local socket
  double connected_s = 0.0;
  bool watches = false;  // receives poses
  bool is_you = false;
};

// The newest change of one thing.
struct LastChange {
  // The key of a setting, such as "isovalue"; or "volume", "voxels", "placement", "series",
  // "forces", "hand", "recording".
  std::string what{};
  std::string by{};  // as DaemonInfo::forces_set_by
  double ago_s = 0.0;
};

struct Activity {
  std::vector<ConnectedCaller> callers{};  // in the order in which they came
  std::vector<LastChange> changes{};       // newest first
};

}  // namespace palpate::client
