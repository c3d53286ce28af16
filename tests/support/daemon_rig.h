// A real palpated with a device, for tests that end it in many ways.
#pragma once

#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/daemon.h"
#include "tests/support/places.h"

namespace palpate::test {

// A daemon that is started again and again, with the same socket and state folder.
class DaemonRig {
 public:
  Daemon& daemon() { return *daemon_; }

  // Ends the daemon as a crash does.
  void Kill() {
    EXPECT_NE(daemon_->End(SIGKILL).exit_code, 0);
    daemon_.reset();
  }
  void End() {
    EXPECT_EQ(daemon_->End().exit_code, 0);
    daemon_.reset();
  }

  v1::GetDeviceResponse Get() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    const grpc::Status status = daemon_->device->GetDevice(&context, {}, &response);
    if (!status.ok()) throw std::runtime_error(status.error_message());
    return response;
  }
  grpc::StatusCode Enable(const std::string& name) {
    grpc::ClientContext context;
    v1::EnableForcesRequest request;
    request.set_device(name);
    v1::EnableForcesResponse response;
    return daemon_->device->EnableForces(&context, request, &response).error_code();
  }
  bool WaitForConnection(v1::DeviceConnection connection) {
    return Eventually([&] { return Get().health().connection() == connection; });
  }
  bool WaitForForces(v1::ForceState state) {
    return Eventually([&] { return Get().forces().state() == state; });
  }

 protected:
  void StartOn(const std::vector<std::string>& wrapper, const std::string& device) {
    const std::filesystem::path file = folder_.path() / "device.toml";
    std::ofstream(file) << "[device]\n" << device;
    daemon_ = std::make_unique<Daemon>(
        kPalpated,
        std::vector<std::string>{"--volume", "builtin:sphere:32", "--config", file.string(),
                                 "--socket", folder_.path() / "palpated.sock", "--state-folder",
                                 folder_.path() / "state"},
        wrapper, std::chrono::seconds(550));
  }

  TemporaryFolder folder_;
  std::unique_ptr<Daemon> daemon_;
};

}  // namespace palpate::test
