// `palpate watch` against a palpated with canned answers: output, exit codes, signals.
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/process.h"
#include "tests/unit/cli_fixture.h"

namespace palpate::test {
namespace {

TEST_F(CliTest, WatchJsonGivesOneObjectPerSample) {
  StartDaemon();
  const ProcessResult result = Run({"watch", "--json", "--rate-hz", "500", "--count", "23"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(result.error, "");
  EXPECT_EQ(daemon_->pose.last_start.rate_hz(), 500.0);
  EXPECT_EQ(daemon_->pose.last_start.batch(), 5u);
  EXPECT_EQ(daemon_->pose.last_start.max_unacknowledged(), 4u);
  const std::vector<std::string> lines = Lines(result.output);
  ASSERT_EQ(lines.size(), 23u);
  const Json sample = Json::parse(lines[1]);
  EXPECT_EQ(sample["tick"], 2);
  EXPECT_EQ(sample["hip_mm"], Json({0.1, 1.0 / 3.0, 2.0}));
  EXPECT_EQ(sample["mode"], "free");
  EXPECT_TRUE(sample["scp_v_mm"].is_null());
  for (const char* key :
       {"time_ns", "scp_h_mm", "scp_h_normal", "scp_v_normal", "force_n", "contact", "density",
        "isovalue", "settings_revision", "volume_revision", "update_ns", "missed_ticks",
        "iterations", "buttons", "stylus_orientation"}) {
    EXPECT_TRUE(sample.contains(key)) << key;
  }
}

TEST_F(CliTest, WatchJsonDefaultsTo60Hz) {
  StartDaemon();
  EXPECT_EQ(Run({"watch", "--json", "--count", "2"}).exit_code, 0);
  EXPECT_EQ(daemon_->pose.last_start.rate_hz(), 60.0);
  EXPECT_EQ(daemon_->pose.last_start.batch(), 1u);
}

TEST_F(CliTest, WatchInALogGivesALineASecondAndASummary) {
  StartDaemon();
  const ProcessResult result = Run({"watch", "--seconds", "2.3"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(daemon_->pose.last_start.rate_hz(), 1000.0);
  EXPECT_EQ(daemon_->pose.last_start.batch(), 32u);
  EXPECT_GE(daemon_->pose.acknowledged.load(), 3u);
  const std::vector<std::string> lines = Lines(result.output);
  ASSERT_EQ(lines.size(), 2u + 7u) << result.output;
  EXPECT_NE(lines[0].find("samples/s"), std::string::npos);
  EXPECT_NE(lines[1].find("isovalue 40.8 (normalised 0.1600)"), std::string::npos) << lines[1];
  EXPECT_EQ(result.output.find('\x1b'), std::string::npos);
  EXPECT_NE(result.output.find("contact         50.0 %"), std::string::npos) << result.output;
  EXPECT_NE(result.output.find("inside surface  0 samples"), std::string::npos);
}

TEST_F(CliTest, WatchCountsInTextToo) {
  StartDaemon();
  const ProcessResult result = Run({"watch", "--count", "40"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("samples         40,"), std::string::npos) << result.output;
}

TEST_F(CliTest, WatchOnATerminalIsLiveAndGivesTheCursorBack) {
  StartDaemon();
  Process process(Command({"watch", "--seconds", "1"}), true);
  const ProcessResult result = process.Wait();
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("\x1b[?25l"), std::string::npos);
  EXPECT_NE(result.output.find("\x1b[11A\x1b[J"), std::string::npos) << result.output;
  EXPECT_NE(result.output.find("] of 3.3 N"), std::string::npos);
  EXPECT_GT(result.output.rfind("\x1b[?25h") + 1, result.output.rfind("\x1b[?25l"));
}

TEST_F(CliTest, WatchOnADumbTerminalIsALog) {
  StartDaemon();
  setenv("TERM", "dumb", 1);
  EXPECT_EQ(Process(Command({"watch", "--count", "64"}), true).Wait().output.find('\x1b'),
            std::string::npos);
}

TEST_F(CliTest, SignalsEndTheWatchWithItsSummary) {
  StartDaemon();
  for (const int signal_number : {SIGINT, SIGTERM}) {
    Process process(Command({"watch"}));
    ASSERT_TRUE(process.WaitFor("samples/s"));
    process.Signal(signal_number);
    const ProcessResult result = process.Wait();
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_EQ(result.error, "");
  }
}

TEST_F(CliTest, SignalEndsJsonOnAWholeLine) {
  StartDaemon();
  Process process(Command({"watch", "--json", "--rate-hz", "1000"}));
  ASSERT_TRUE(process.WaitFor("\"tick\":100,"));
  process.Signal(SIGINT);
  const ProcessResult result = process.Wait();
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_TRUE(Json::accept(Lines(result.output).back()));
}

TEST_F(CliTest, SignalEndsAWatchThatNobodyReads) {
  StartDaemon();
  Process process(Command({"watch", "--json", "--rate-hz", "1000"}));
  ASSERT_TRUE(process.WaitFor("\"tick\":"));
  // The pipe is full after about 150 samples.
  std::this_thread::sleep_for(std::chrono::seconds(1));
  process.Signal(SIGINT);
  EXPECT_EQ(process.Wait().exit_code, 0);
}

TEST_F(CliTest, ClosedOutputEndsQuietly) {
  StartDaemon();
  Process process(Command({"watch", "--json", "--rate-hz", "1000"}));
  ASSERT_TRUE(process.WaitFor("\"tick\":10,"));
  process.CloseOutput();
  const ProcessResult result = process.Wait();
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.error, "");
}

TEST_F(CliTest, DaemonGoingAwayEndsTheWatchWithExitCode8) {
  StartDaemon();
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"watch"}, {"watch", "--json"}}) {
    Process process(Command(arguments));
    ASSERT_TRUE(process.WaitFor(arguments.size() == 1 ? "samples/s" : "\"tick\""));
    daemon_->Die();
    const ProcessResult result = process.Wait();
    ExpectOneError(result, 8, "went away");
    daemon_.reset();
    StartDaemon();
  }
}

}  // namespace
}  // namespace palpate::test
