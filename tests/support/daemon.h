// A real palpated in a folder of its own, for tests over real sockets.
#pragma once

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/pose.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "tests/support/patience.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace palpate::test {

class Daemon {
 public:
  static constexpr std::chrono::seconds kPatience{120};

  // Starts `program` with `arguments` and waits until it is ready. Adds a socket and a state folder
  // if the arguments name none. `patience`: see Process.
  Daemon(const std::string& program, std::vector<std::string> arguments,
         const std::vector<std::string>& wrapper = {}, std::chrono::seconds patience = kPatience)
      : socket_(folder_.path() / "palpated.sock") {
    std::vector<std::string> command = wrapper;
    command.push_back(program);
    command.insert(command.end(), arguments.begin(), arguments.end());
    const auto socket = std::find(arguments.begin(), arguments.end(), "--socket");
    if (socket != arguments.end()) {
      socket_ = *std::next(socket);
    } else {
      command.insert(command.end(), {"--socket", socket_.string()});
    }
    if (std::find(arguments.begin(), arguments.end(), "--state-folder") == arguments.end()) {
      command.insert(command.end(), {"--state-folder", folder_.path() / "state"});
    }
    const auto config = std::find(arguments.begin(), arguments.end(), "--config");
    if (config != arguments.end() && !Holds(*std::next(config), "load_folders")) {
      command.insert(command.end(), {"--load-folder", "/"});
    }
    if (config == arguments.end()) {
      // Tests may load from everywhere, and save only into the tests' folders.
      std::ofstream(folder_.path() / "palpated.toml")
          << "[volume]\nload_folders = [\"/\"]\nsave_folders = [\""
          << folder_.path().parent_path().string() << "\"]\n";
      command.insert(command.end(), {"--config", folder_.path() / "palpated.toml"});
    }
    process_ = std::make_unique<Process>(command, patience);
    if (!process_->WaitFor("ready on")) {
      throw std::runtime_error("palpated did not start: " + process_->Wait().error);
    }
    channel_ = grpc::CreateChannel("unix:" + socket_.string(), grpc::InsecureChannelCredentials());
    poses = v1::PoseService::NewStub(channel_);
    render = v1::RenderService::NewStub(channel_);
    device = v1::DeviceService::NewStub(channel_);
  }

  // Ends the daemon in order, unless the test has ended it. The test fails if the daemon crashes,
  // leaks or hangs at its end.
  ~Daemon() { process_->EndInOrder(); }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  // Ends the daemon with a signal. Returns its output.
  ProcessResult End(int signal = SIGTERM) {
    process_->Signal(signal);
    return process_->Wait();
  }

  // Waits until the daemon's loop has made this many more ticks, however slow the machine is.
  bool WaitForTicks(std::uint64_t more) {
    const std::uint64_t first = Ticks();
    return Eventually([&] { return Ticks() >= first + more; });
  }

  const std::filesystem::path& socket() const { return socket_; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  Process& process() { return *process_; }

  std::unique_ptr<v1::PoseService::Stub> poses;
  std::unique_ptr<v1::RenderService::Stub> render;
  std::unique_ptr<v1::DeviceService::Stub> device;

 private:
  static bool Holds(const std::filesystem::path& file, const std::string& text) {
    std::ostringstream all;
    all << std::ifstream(file).rdbuf();
    return all.str().find(text) != std::string::npos;
  }
  std::uint64_t Ticks() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    const grpc::Status status = device->GetDevice(&context, {}, &response);
    if (!status.ok()) throw std::runtime_error(status.error_message());
    return response.servo().ticks();
  }

  TemporaryFolder folder_;
  std::filesystem::path socket_;
  std::unique_ptr<Process> process_;
  std::shared_ptr<grpc::Channel> channel_;
};

// Reads and acknowledges a stream of poses at full rate, on a thread of its own.
class PoseCollector {
 public:
  explicit PoseCollector(Daemon& daemon) {
    stream_ = daemon.poses->StreamPoses(&context_);
    v1::StreamPosesRequest start;
    start.mutable_start()->set_rate_hz(1000);
    start.mutable_start()->set_batch(16);
    start.mutable_start()->set_max_unacknowledged(8);
    stream_->Write(start);
    thread_ = std::thread([this] { Read(); });
  }
  ~PoseCollector() { Stop(); }

  // Ends the stream. Returns all samples in order.
  const std::vector<v1::PoseSample>& Stop() {
    if (thread_.joinable()) {
      context_.TryCancel();
      thread_.join();
      stream_->Finish();
    }
    return samples_;
  }

 private:
  void Read() {
    v1::StreamPosesResponse message;
    while (stream_->Read(&message)) {
      samples_.insert(samples_.end(), message.samples().begin(), message.samples().end());
      v1::StreamPosesRequest acknowledge;
      acknowledge.mutable_acknowledgement()->set_message_number(message.message_number());
      stream_->Write(acknowledge);
    }
  }

  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::StreamPosesRequest, v1::StreamPosesResponse>>
      stream_;
  std::vector<v1::PoseSample> samples_;
  std::thread thread_;
};

}  // namespace palpate::test
