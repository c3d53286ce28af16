// Recordings of a real daemon, as scripts make and use them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "palpate/v1/recording.grpc.pb.h"
#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/nrrd.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

constexpr std::chrono::seconds kPatience{60};

void Sleep(int ms) { std::this_thread::sleep_for(std::chrono::milliseconds(ms)); }

class RecordingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:gyroid:64"});
    recording_ = v1::RecordingService::NewStub(daemon_->channel());
  }

  std::string File(const std::string& name) const { return (folder_.path() / name).string(); }
  ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments, false, kPatience).Wait();
  }
  static ProcessResult Lab(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpateLab);
    return Process(arguments, false, kPatience).Wait();
  }
  grpc::Status Start(const std::string& path, bool overwrite = false) {
    grpc::ClientContext context;
    v1::StartRecordingRequest request;
    request.set_path(path);
    request.set_overwrite(overwrite);
    v1::StartRecordingResponse response;
    return recording_->StartRecording(&context, request, &response);
  }
  v1::RecordingState Stop() {
    grpc::ClientContext context;
    v1::StopRecordingResponse response;
    const grpc::Status status = recording_->StopRecording(&context, {}, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.recording();
  }
  v1::RecordingState Get() {
    grpc::ClientContext context;
    v1::GetRecordingResponse response;
    EXPECT_TRUE(recording_->GetRecording(&context, {}, &response).ok());
    return response.recording();
  }
  grpc::StatusCode Mark(const std::string& text) {
    grpc::ClientContext context;
    v1::MarkRequest request;
    request.set_text(text);
    v1::MarkResponse response;
    return recording_->Mark(&context, request, &response).error_code();
  }
  grpc::Status Replay(const std::string& path, double speed,
                      std::vector<v1::ReplayResponse>* events = nullptr) {
    grpc::ClientContext context;
    v1::ReplayRequest request;
    request.set_path(path);
    request.set_speed(speed);
    const auto reader = recording_->Replay(&context, request);
    for (v1::ReplayResponse event; reader->Read(&event);) {
      if (events) events->push_back(event);
    }
    return reader->Finish();
  }
  void AwaitTicks(std::uint64_t ticks) {
    while (Get().running() && Get().ticks() < ticks) Sleep(20);
  }

  // What `palpate-lab replay --recording` says of `key`: the first number.
  static std::uint64_t Figure(const ProcessResult& replay, const std::string& key) {
    std::istringstream lines(replay.output);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::string word;
      std::uint64_t number = 0;
      if (words >> word >> number && word == key) return number;
    }
    ADD_FAILURE() << "no " << key << " in " << replay.output << replay.error;
    return 0;
  }

  TemporaryFolder folder_;
  std::unique_ptr<Daemon> daemon_;
  std::unique_ptr<v1::RecordingService::Stub> recording_;
};

TEST_F(RecordingTest, ComesBackBitForBitThroughSettingsAndLoads) {
  EXPECT_EQ(Run({"record", "status"}).output, "not recording\n");
  ASSERT_EQ(Run({"record", "start", File("a.palrec")}).exit_code, 0);
  for (int n = 0; n < 10; ++n) {
    v1::UpdateSettingsRequest request;
    request.mutable_settings()->set_normalized_isovalue(0.4 + 0.02 * n);
    request.mutable_settings()->set_passivity_control(n % 2 == 1);
    request.mutable_update_mask()->add_paths("normalized_isovalue");
    request.mutable_update_mask()->add_paths("passivity_control");
    grpc::ClientContext context;
    v1::UpdateSettingsResponse response;
    ASSERT_TRUE(daemon_->render->UpdateSettings(&context, request, &response).ok());
    Sleep(150);
  }
  EXPECT_EQ(Mark("half, \"way\""), grpc::StatusCode::OK);
  ASSERT_EQ(Run({"load", "builtin:bumps:48", "--spacing-mm", "1,1,0.5"}).exit_code, 0);
  Sleep(500);
  EXPECT_EQ(Run({"mark", "last"}).exit_code, 0);
  Sleep(50);
  const ProcessResult stop = Run({"record", "stop", "--json"});
  ASSERT_EQ(stop.exit_code, 0) << stop.error;
  const auto state = nlohmann::json::parse(stop.output);
  EXPECT_EQ(state["lost_ticks"], 0);
  EXPECT_EQ(state["size_bytes"], std::filesystem::file_size(File("a.palrec")));
  const std::uint64_t ticks = state["ticks"];
  EXPECT_GT(ticks, 1500u) << kBusyMachine;

  const ProcessResult replay = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(replay.exit_code, 0) << replay.output << replay.error;
  EXPECT_EQ(Figure(replay, "ticks"), ticks);
  EXPECT_EQ(Figure(replay, "differing"), 0u);
  EXPECT_GE(Figure(replay, "compared") + 70, ticks);
  EXPECT_EQ(Figure(replay, "markers"), 2u);
  EXPECT_GE(Figure(replay, "scenes"), 12u);

  const ProcessResult table = Lab({"export", File("a.palrec"), "--out", File("a.csv")});
  EXPECT_EQ(table.exit_code, 0) << table.error;
  std::ifstream in(File("a.csv"));
  std::uint64_t rows = 0, marked = 0;
  for (std::string line; std::getline(in, line); ++rows) {
    marked += line.ends_with(",\"half, \"\"way\"\"\"") || line.ends_with(",last");
  }
  EXPECT_EQ(rows, ticks + 1);
  EXPECT_EQ(marked, 2u);
  std::printf("%llu ticks, %.1f bytes each\n", static_cast<unsigned long long>(ticks),
              state["size_bytes"].get<double>() / static_cast<double>(ticks));
}

TEST_F(RecordingTest, AKilledDaemonLeavesAllButTheLastSeconds) {
  ASSERT_TRUE(Start(File("a.palrec")).ok());
  AwaitTicks(3000);
  const std::uint64_t written = Get().ticks();
  EXPECT_EQ(daemon_->End(SIGKILL).exit_code, -SIGKILL);
  const ProcessResult replay = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(replay.exit_code, 0) << replay.error;
  EXPECT_NE(replay.error.find("was not closed"), std::string::npos) << replay.error;
  EXPECT_GE(Figure(replay, "ticks"), written);
  EXPECT_GE(Figure(replay, "compared") + 70, Figure(replay, "ticks"));
  EXPECT_EQ(Figure(replay, "differing"), 0u);
  // Cut within a chunk, as by a power failure.
  std::filesystem::resize_file(File("a.palrec"),
                               std::filesystem::file_size(File("a.palrec")) - 1000);
  const ProcessResult cut = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(cut.exit_code, 0) << cut.error;
  EXPECT_NE(cut.error.find("is cut"), std::string::npos) << cut.error;
  EXPECT_EQ(Figure(cut, "differing"), 0u);
  EXPECT_LT(Figure(cut, "ticks"), Figure(replay, "ticks"));
}

TEST_F(RecordingTest, AnEndingDaemonClosesIt) {
  ASSERT_TRUE(Start(File("a.palrec")).ok());
  AwaitTicks(1000);
  EXPECT_EQ(daemon_->End().exit_code, 0);
  const ProcessResult replay = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(replay.exit_code, 0) << replay.error;
  EXPECT_EQ(replay.error, "");
}

TEST_F(RecordingTest, BadCallsAreRefused) {
  using grpc::StatusCode;
  EXPECT_EQ(Start("").error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Start("relative.palrec").error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Start(std::string("/tmp/a\0b", 8)).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Start(File("no/folder")).error_code(), StatusCode::NOT_FOUND);
  EXPECT_EQ(Start("/var/a.palrec").error_code(), StatusCode::PERMISSION_DENIED);
  EXPECT_EQ(Mark("m"), StatusCode::ABORTED);
  EXPECT_EQ(Run({"record", "stop"}).exit_code, ExitCode(ErrorKind::kConflict));
  ASSERT_TRUE(Start(File("a")).ok());
  EXPECT_EQ(Start(File("b")).error_code(), StatusCode::ABORTED);
  EXPECT_EQ(Mark(""), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Mark(std::string(4097, 'x')), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Replay(File("a"), 1.0).error_code(), StatusCode::ABORTED);
  AwaitTicks(100);
  EXPECT_TRUE(Get().running());
  Stop();
  EXPECT_FALSE(Get().running());
  EXPECT_EQ(Get().path(), File("a"));
  EXPECT_EQ(Start(File("a")).error_code(), StatusCode::ABORTED);
  EXPECT_TRUE(Start(File("a"), true).ok());
  AwaitTicks(1000);
  Stop();
  EXPECT_EQ(Replay("a", 1.0).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Replay(File("absent"), 1.0).error_code(), StatusCode::NOT_FOUND);
  EXPECT_EQ(Replay(File("a"), -1.0).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Replay(File("a"), 101.0).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Replay(folder_.path().string(), 1.0).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Lab({"replay", "--recording", File("absent")}).exit_code,
            ExitCode(ErrorKind::kNotFound));
  EXPECT_EQ(Lab({"replay", "--recording", File("a"), "--isovalue", "1"}).exit_code, kUsageExitCode);
  EXPECT_EQ(Lab({"replay", "--volume", "builtin:bumps"}).exit_code, kUsageExitCode);
  EXPECT_EQ(Lab({"replay", "--recording", File("a"), "--volume", "builtin:bumps"}).exit_code,
            ExitCode(ErrorKind::kConflict));
  EXPECT_EQ(Lab({"export", File("a"), "--out", File("no/folder")}).exit_code,
            ExitCode(ErrorKind::kUnavailable));
}

// Their files are gone, or give other ranges of values: the recording has the voxels.
TEST_F(RecordingTest, SeriesAndUploadsComeBackFromTheRecordingAlone) {
  const auto write = [&](const std::string& name, double shift) {
    testing::WriteNrrd(folder_.path() / name, Vec3i(30, 28, 26), [&](int i, int j, int k) {
      const double x = i - 14.5, y = j - 13.5, z = k - 12.5;
      return static_cast<float>(std::sqrt(x * x + y * y + z * z) + shift * std::sin(0.5 * i));
    });
  };
  for (int frame = 0; frame < 4; ++frame) write("t" + std::to_string(frame) + ".nrrd", frame);
  write("sent.nrrd", 0.5);
  ASSERT_EQ(Run({"series", "load", File("t*.nrrd"), "--normalized-isovalue", "0.4"}).exit_code, 0);
  ASSERT_EQ(Run({"series", "seek", "1"}).exit_code, 0);
  const ProcessResult start = Run({"record", "start", File("a.palrec")});
  ASSERT_EQ(start.exit_code, 0) << start.error;
  EXPECT_EQ(start.error, "");
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
           {"interpolate", "on"}, {"loop", "on"}, {"rate", "7"}, {"play"}}) {
    std::vector<std::string> arguments = words;
    arguments.insert(arguments.begin(), "series");
    ASSERT_EQ(Run(arguments).exit_code, 0);
  }
  Sleep(1000);
  ASSERT_EQ(Run({"upload", File("sent.nrrd"), "--normalized-isovalue", "0.4"}).exit_code, 0);
  Sleep(300);
  ASSERT_EQ(Run({"edit", "sphere", "--center-mm", "14,14,3", "--radius-mm", "4", "--operation",
                 "set", "--value", "20"})
                .exit_code,
            0);
  Sleep(300);
  const ProcessResult stop = Run({"record", "stop", "--json"});
  ASSERT_EQ(stop.exit_code, 0) << stop.error;
  const auto state = nlohmann::json::parse(stop.output);
  EXPECT_EQ(state["left_out"], "");
  for (const char* name : {"t0.nrrd", "t1.nrrd", "t2.nrrd", "t3.nrrd", "sent.nrrd"}) {
    std::filesystem::remove(File(name));
  }
  const ProcessResult replay = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(replay.exit_code, 0) << replay.output << replay.error;
  EXPECT_EQ(Figure(replay, "differing"), 0u);
  EXPECT_EQ(Figure(replay, "ticks"), state["ticks"]);
  EXPECT_GE(Figure(replay, "compared") + 70, state["ticks"]);
}

// A load of a file is named and not held: where the file is gone, that is an error.
TEST_F(RecordingTest, TicksThatAreMissingAreAnError) {
  testing::WriteNrrd(folder_.path() / "a.nrrd", Vec3i(20, 20, 20),
                     [](int i, int j, int k) { return static_cast<float>(i * j + k); });
  ASSERT_TRUE(Start(File("a.palrec")).ok());
  AwaitTicks(500);
  ASSERT_EQ(Run({"load", File("a.nrrd")}).exit_code, 0);
  Sleep(200);
  Stop();
  EXPECT_EQ(Lab({"replay", "--recording", File("a.palrec")}).exit_code, 0);
  std::filesystem::remove(File("a.nrrd"));
  const ProcessResult replay = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(replay.exit_code, ExitCode(ErrorKind::kConflict)) << replay.output;
  EXPECT_NE(replay.error.find("could not be computed again"), std::string::npos) << replay.error;
  EXPECT_NE(replay.error.find("--allow-missing"), std::string::npos) << replay.error;
  const ProcessResult allowed = Lab({"replay", "--recording", File("a.palrec"), "--allow-missing"});
  EXPECT_EQ(allowed.exit_code, 0) << allowed.error;
  EXPECT_GT(Figure(allowed, "compared"), 300u);
}

// More than 64 MiB of voxels that no file gives again.
TEST_F(RecordingTest, WhatCannotBeComputedAgainIsSaidAtOnce) {
  constexpr int kSize = 264;
  {
    std::ofstream raw(File("large.dat"), std::ios::binary);
    std::string plane(kSize * kSize, '\1');
    for (int k = 0; k < kSize; ++k) {
      plane.assign(plane.size(), static_cast<char>(k / 3));
      raw << plane;
    }
  }
  ASSERT_EQ(Run({"upload", File("large.dat"), "--raw-size", "264,264,264", "--raw-type", "uint8"})
                .exit_code,
            0);
  const ProcessResult start = Run({"record", "start", File("a.palrec")});
  EXPECT_EQ(start.exit_code, 0);
  EXPECT_NE(start.error.find("upload:large.dat is too large"), std::string::npos) << start.error;
  AwaitTicks(300);
  const auto state = nlohmann::json::parse(Run({"record", "status", "--json"}).output);
  EXPECT_NE(state["left_out"], "");
  Stop();
  const ProcessResult replay = Lab({"replay", "--recording", File("a.palrec")});
  EXPECT_EQ(replay.exit_code, ExitCode(ErrorKind::kNotFound));
  EXPECT_NE(replay.error.find("with --volume"), std::string::npos) << replay.error;
  EXPECT_EQ(replay.error.find("no such file"), std::string::npos) << replay.error;
}

TEST_F(RecordingTest, IsPlayedToThoseWhoWatch) {
  ASSERT_TRUE(Start(File("a.palrec")).ok());
  AwaitTicks(1000);
  Mark("here");
  Sleep(200);
  const v1::RecordingState state = Stop();
  PoseCollector viewer(*daemon_);
  std::vector<v1::ReplayResponse> events;
  const grpc::Status status = Replay(File("a.palrec"), 0.0, &events);
  EXPECT_TRUE(status.ok()) << status.error_message();
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.back().ticks(), state.ticks());
  EXPECT_EQ(std::count_if(events.begin(), events.end(),
                          [](const auto& event) { return event.marker() == "here"; }),
            1);
  Sleep(200);
  const std::vector<v1::PoseSample>& samples = viewer.Stop();
  ASSERT_FALSE(samples.empty());
  // Nothing of the live, suspended ticks is shown but at the two ends.
  std::size_t suspended = 0;
  for (std::size_t n = 0; n < samples.size(); ++n) {
    suspended += samples[n].mode() == v1::PROXY_MODE_SUSPENDED;
    EXPECT_TRUE(n == 0 || samples[n].tick() > samples[n - 1].tick());
  }
  // The live loop is the clock. What it misses passes unseen, and is counted.
  const std::uint64_t missed = samples.back().missed_ticks() - samples.front().missed_ticks();
  EXPECT_GT(samples.size() + viewer.dropped() + missed, state.ticks());
  EXPECT_GT(samples.size(), state.ticks() / 4) << kBusyMachine;
  EXPECT_LT(suspended, 100u) << kBusyMachine;
  EXPECT_NE(samples.back().mode(), v1::PROXY_MODE_SUSPENDED);

  EXPECT_EQ(Run({"replay", File("a.palrec"), "--speed", "20"}).exit_code, 0);
  ASSERT_EQ(Run({"load", "builtin:bumps:48"}).exit_code, 0);
  const ProcessResult refused = Run({"replay", File("a.palrec")});
  EXPECT_EQ(refused.exit_code, ExitCode(ErrorKind::kConflict));
  EXPECT_NE(refused.error.find("load builtin:gyroid:64"), std::string::npos) << refused.error;
}

TEST_F(RecordingTest, TheClientRecordsUntilItIsInterrupted) {
  const ProcessResult timed = Run({"record", "run", File("a.palrec"), "--seconds", "0.5"});
  EXPECT_EQ(timed.exit_code, 0) << timed.error;
  EXPECT_NE(timed.output.find("bytes per tick"), std::string::npos) << timed.output;
  Process client({test::kPalpate, "record", "run", File("b.palrec"), "--socket", daemon_->socket()},
                 false, kPatience);
  while (!Get().running()) Sleep(20);
  EXPECT_EQ(Run({"replay", File("a.palrec")}).exit_code, ExitCode(ErrorKind::kConflict));
  client.Signal(SIGINT);
  const ProcessResult interrupted = client.Wait();
  EXPECT_EQ(interrupted.exit_code, 0) << interrupted.error;
  EXPECT_FALSE(Get().running());

  ASSERT_TRUE(Start(File("c.palrec")).ok());
  Mark("begun");
  AwaitTicks(1000);
  Stop();
  const std::vector<std::string> slowly = {test::kPalpate, "replay",   File("c.palrec"), "--speed",
                                           "0.1",          "--socket", daemon_->socket()};
  Process replay(slowly, false, kPatience);
  ASSERT_TRUE(replay.WaitFor("begun"));
  EXPECT_EQ(Start(File("d.palrec")).error_code(), grpc::StatusCode::ABORTED);
  replay.Signal(SIGINT);
  EXPECT_EQ(replay.Wait().exit_code, ExitCode(ErrorKind::kCancelled));
  // The daemon ends though one runs.
  Process other(slowly, false, kPatience);
  ASSERT_TRUE(other.WaitFor("begun"));
  const ProcessResult daemon = daemon_->End();
  EXPECT_EQ(daemon.exit_code, 0) << daemon.error;
  EXPECT_NE(other.Wait().exit_code, 0);
}

}  // namespace
}  // namespace palpate::test
