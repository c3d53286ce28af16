// Who uses the daemon, and who changed what last.
//
// A caller is an identity at an address, on however many connections; all clients on the local
// socket are one caller. A caller is here while one of its calls runs, and for kHere after its last
// one. Beyond kMostCallers, further ones are not remembered.
//
// Threads: any. Memory: a few hundred bytes for each caller that is here, and for each thing that
// can be changed. Errors: none.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/security/methods.h"

namespace palpate {

// Such as "local socket", "token ada at ipv4:192.0.2.7:51544".
std::string WhoInWords(const Identity& caller, const std::string& peer);
// The peer as people read it: without gRPC's escapes; empty for the local socket.
std::string PeerInWords(const std::string& peer);

class Activity {
 public:
  static constexpr std::chrono::seconds kHere{10};
  static constexpr std::size_t kMostCallers = 64;

  struct Caller {
    Identity identity{};    // with the role of its newest call
    std::string address{};  // as gRPC names it, without the port
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
  // Called after each Changed and MayHaveChanged, on its thread; must not wait. Set it before the
  // first.
  using OnChange = std::function<void(std::string_view what)>;
  void SetOnChange(OnChange call) { on_change_ = std::move(call); }
  // The thing was changed. `what`: one of a few names.
  void Changed(std::string_view what, std::string by, std::int64_t now_ns);
  void MayHaveChanged(std::string_view what) const {
    if (on_change_) on_change_(what);
  }

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
  using Callers = std::map<std::pair<std::string, std::string>, Seen>;  // by address and name

  static bool IsGone(const Seen& seen, std::int64_t now_ns);

  OnChange on_change_;

  mutable std::mutex mutex_;  // guards what follows
  Callers callers_;
  std::uint64_t came_ = 0;
  std::vector<Change> changes_;  // the newest last
};

}  // namespace palpate
