// The settings thread. The daemon does not stream its settings, but every pose has their revision.
// When the revision changes, this thread asks for the settings.
//
// Threads: one of its own; call all methods from any. Ownership: borrows its arguments. Call
// Begin() once. Call End() before the arguments are destroyed.
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
  // Joins the thread. Call it after Monitor::Stop and Link::CancelCalls.
  void End();

  std::optional<Settings> Newest() const;
  // Sets the settings of a new connection. Those of the connection before are void.
  void Replace(const Settings& settings);
  // Takes the settings that a call brought in `epoch`, unless newer ones are known.
  void Take(const Settings& settings, std::uint64_t epoch);
  // Asks for the settings, because they have changed.
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
  bool is_new_ = false;  // newest_ is not reported yet
  bool asked_ = false;
  bool ending_ = false;

  std::thread thread_;
};

}  // namespace palpate::client
