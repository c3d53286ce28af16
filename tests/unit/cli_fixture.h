// Shared by the tests of the command line: runs `palpate` against a palpated with canned answers.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/unit/cli_fake_daemon.h"

namespace palpate::test {

using Json = nlohmann::json;

inline std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(line);
  }
  return lines;
}

// Expects one line that begins with "palpate: ", as all errors do.
inline void ExpectOneError(const ProcessResult& result, int exit_code, const std::string& part) {
  EXPECT_EQ(result.exit_code, exit_code) << result.error;
  EXPECT_EQ(result.error.rfind("palpate: ", 0), 0u) << result.error;
  EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1) << result.error;
  EXPECT_NE(result.error.find(part), std::string::npos) << result.error;
}

class CliTest : public testing::Test {
 protected:
  CliTest() {
    char name[] = "/tmp/palpate-cli-XXXXXX";
    folder_ = mkdtemp(name);
    socket_ = folder_ + "/palpated.sock";
    setenv("PALPATE_SOCKET", socket_.c_str(), 1);
    setenv("TERM", "xterm", 1);
  }
  ~CliTest() override {
    daemon_.reset();
    std::filesystem::remove_all(folder_);
  }

  void StartDaemon(bool complete = true) {
    daemon_ = std::make_unique<FakeDaemon>(socket_, complete);
  }

  static std::vector<std::string> Command(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    return arguments;
  }
  static ProcessResult Run(const std::vector<std::string>& arguments) {
    return Process(Command(arguments)).Wait();
  }

  std::string folder_;
  std::string socket_;
  std::unique_ptr<FakeDaemon> daemon_;
};

}  // namespace palpate::test
