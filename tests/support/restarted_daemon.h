// A palpated that can be killed and started again on the same socket. It loads from everywhere, and
// saves into its own folder.
#pragma once

#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace palpate::test {

class RestartedDaemon {
 public:
  // `config`: more lines of its configuration.
  explicit RestartedDaemon(std::vector<std::string> arguments = {"--volume", "builtin:bumps:48"},
                           const std::string& config = "")
      : arguments_(std::move(arguments)) {
    std::ofstream(folder() / "palpated.toml")
        << "[volume]\nload_folders = [\"/\"]\nsave_folders = [\"" << folder().string() << "\"]\n"
        << config;
  }
  // Ends the daemon in order, unless the test has killed it.
  ~RestartedDaemon() {
    if (process_) process_->EndInOrder();
  }
  RestartedDaemon(const RestartedDaemon&) = delete;
  RestartedDaemon& operator=(const RestartedDaemon&) = delete;

  // Waits until the daemon is ready.
  void Start() {
    std::vector<std::string> command = {kPalpated};
    command.insert(command.end(), arguments_.begin(), arguments_.end());
    command.insert(command.end(), {"--socket", socket(), "--state-folder", folder() / "s",
                                   "--config", folder() / "palpated.toml"});
    process_ = std::make_unique<Process>(command);
    if (!process_->WaitFor("ready on")) {
      throw std::runtime_error("palpated did not start: " + process_->Wait().error);
    }
  }
  void Kill() {
    process_->Signal(SIGKILL);
    process_->Wait();
    process_.reset();
    // The session, which is saved twice a second: the next daemon starts as the first did.
    std::filesystem::remove_all(folder() / "s");
  }
  // Behaves like a machine that hangs: connections stay, and nothing answers. Waits until its last
  // thread stands still.
  void Hang() {
    process_->Signal(SIGSTOP);
    const std::filesystem::path tasks = "/proc/" + std::to_string(process_->pid()) + "/task";
    EXPECT_TRUE(Eventually([&] {
      for (const auto& task : std::filesystem::directory_iterator(tasks)) {
        std::string stat;
        std::getline(std::ifstream(task.path() / "stat"), stat);
        if (stat.find(") T ") == std::string::npos) return false;
      }
      return true;
    }));
  }
  void Continue() { process_->Signal(SIGCONT); }

  std::string socket() const { return folder() / "palpated.sock"; }
  const std::filesystem::path& folder() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
  std::vector<std::string> arguments_;
  std::unique_ptr<Process> process_;
};

}  // namespace palpate::test
