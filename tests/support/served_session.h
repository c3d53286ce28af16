// A RunningSession behind a real server on a Unix socket, in this process.
#pragma once

#include <prometheus/registry.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/client_paths/path_policy.h"
#include "server/services/server.h"
#include "tests/support/running_session.h"

namespace palpate::testing {

// The servo runs once the test starts data(). Load before server().Start().
class ServedSession {
 public:
  explicit ServedSession(
      const std::string& socket, const LimitOptions& limits = {},
      DeviceList list = [] { return std::vector<ListedDevice>(); })
      : server_({.socket_path = socket,
                 .listen = {},
                 .paths = {},
                 .uploads = {},
                 .security = {.limits = limits}},
                {data_.session(), editor_, series_, recording_, data_.pump(), data_.simulated(),
                 nullptr, data_.servo(), stop_door_, data_.inbox(), forces_, std::move(list),
                 metrics_}) {}

  RunningSession& data() { return data_; }
  RpcServer& server() { return server_; }
  StopDoor& stop_door() { return stop_door_; }

 private:
  RunningSession data_;
  VolumeEditor editor_{data_.session()};
  SeriesPlayer series_{data_.session()};
  RecordingControl recording_{data_.session(),
                              data_.pump(),
                              {[](const std::string& path) { return path; },
                               [](const std::string& path) {
                                 return PathPolicy({.load_folders = {"/"}}).OpenToLoad(path);
                               }},
                              "test",
                              SafetyLimits{},
                              PassivityDevice{}};
  StopDoor stop_door_{data_.servo(), data_.outbox().last, data_.simulated(), 1};
  const ForceWatch forces_{data_.outbox().last};
  prometheus::Registry registry_;
  ServiceMetrics metrics_{registry_};
  RpcServer server_;
};

}  // namespace palpate::testing
