// The facts thread: follows what the daemon tells, while there is a connection.
//
// Threads: one of its own; call all methods from any. Ownership: borrows its arguments. Call
// Begin() once. Call End() before the arguments are destroyed.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "client/sdk/facts.h"
#include "client/sdk/link.h"
#include "client/sdk/monitor.h"
#include "palpate/v1/facts.grpc.pb.h"

namespace palpate::client {

class FactsFollower {
 public:
  struct Events {
    std::function<void(const Settings&)> settings{};
    std::function<void(const Facts&)> facts{};
  };

  FactsFollower(Link& link, Monitor& monitor, Events events)
      : link_(link), monitor_(monitor), events_(std::move(events)) {}
  ~FactsFollower() { End(); }

  void Begin();
  // Joins the thread. Call it after Monitor::Stop and Link::CancelCalls.
  void End();

  // Never null.
  std::shared_ptr<const Facts> Newest() const;
  std::optional<Settings> NewestSettings() const;
  // Sets the settings of a new connection. Those of the connection before are void.
  void Replace(const Settings& settings);
  // Takes the settings that a call brought in `epoch`, unless newer ones are known.
  void Take(const Settings& settings, std::uint64_t epoch);

 private:
  void Run();
  void Follow(std::uint64_t epoch);
  static void Merge(const v1::Facts& message, Facts& facts);
  void Put(const Facts& facts, std::uint64_t epoch);

  Link& link_;
  Monitor& monitor_;
  const Events events_;

  mutable std::mutex mutex_;
  std::shared_ptr<const Facts> newest_ = std::make_shared<const Facts>();
  std::optional<Settings> settings_;

  std::thread thread_;
};

}  // namespace palpate::client
