// The settings thread: the daemon does not stream its settings, but every pose names
// their revision; when it changes they are asked for.
//
// Threads: one of its own; all methods from any. Ownership: borrows all that it is
// given. Begin() once; End() before what it borrowed goes.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "client/sdk/link.h"
#include "client/sdk/monitor.h"
#include "client/sdk/settings.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::client {

class SettingsFollower {
 public:
  SettingsFollower(Link& link, Monitor& monitor, std::function<void(const Settings&)> on_settings);
  ~SettingsFollower() { End(); }

  void Begin();
  // After Monitor::Stop and Link::CancelCalls: joins.
  void End();

  std::optional<Settings> Newest() const;
  // Those of a connection that begins: what was known is void.
  void Replace(const Settings& settings);
  // Those that a call brought in `epoch`; older ones than are known are left.
  void Take(const Settings& settings, std::uint64_t epoch);
  // They changed: ask.
  void Ask();

 private:
  void Run();
  void Fetch();

  Link& link_;
  Monitor& monitor_;
  const std::function<void(const Settings&)> on_settings_;

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::optional<Settings> newest_;
  bool is_new_ = false;  // newest_ is yet to be reported
  bool asked_ = false;
  bool ending_ = false;

  std::thread thread_;
};

}  // namespace palpate::client
