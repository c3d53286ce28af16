// Who uses the daemon, and who changed what last.
//
// A caller is an identity on a connection (gRPC's peer). All clients on the local socket have one
// peer and are one caller. A caller is here while one of its calls runs, and for kHere after its
// last one.
//
// Threads: any. Memory: a few hundred bytes for each caller that is here, at most kMostCallers, and
// for each thing that can be changed. Errors: none.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/security/role.h"

namespace palpate {

// Such as "local socket", "token ada at ipv4:192.0.2.7:51544".
std::string WhoInWords(const Identity& caller, const std::string& peer);
// The peer as people read it: without gRPC's escapes; empty for the local socket.
std::string PeerInWords(const std::string& peer);

class Activity {
 public:
  static constexpr std::chrono::seconds kHere{10};
  static constexpr std::size_t kMostCallers = 4096;

  struct Caller {
    Identity identity{};  // with the role of its newest call
    std::string peer{};   // as gRPC names it
    std::int64_t came_ns = 0;
    bool watches = false;  // has a stream of poses
  };
  struct Change {
    std::string what{};
    std::string by{};
    std::int64_t time_ns = 0;
  };

  // A call was admitted. If this returns true, call Left with the same values when the call is
  // over. False: there are too many callers to remember this one.
  bool Came(const Identity& identity, const std::string& peer, bool watches, std::int64_t now_ns);
  void Left(const Identity& identity, const std::string& peer, bool watches, std::int64_t now_ns);
  // The thing was changed. `what`: one of a few names.
  void Changed(std::string_view what, std::string by, std::int64_t now_ns);

  // Those who are here, in the order in which they came.
  std::vector<Caller> callers(std::int64_t now_ns) const;
  // The newest change of each thing, newest first.
  std::vector<Change> changes() const;

 private:
  struct Seen {
    Caller caller{};
    std::uint64_t number = 0;  // rises in the order in which they came
    int calls = 0;             // that run
    int pose_streams = 0;
    std::int64_t last_ns = 0;
  };
  using Callers = std::map<std::pair<std::string, std::string>, Seen>;  // by peer and name

  static bool IsGone(const Seen& seen, std::int64_t now_ns);

  mutable std::mutex mutex_;
  Callers callers_;
  std::uint64_t came_ = 0;
  std::vector<Change> changes_;  // the newest last
};

}  // namespace palpate
