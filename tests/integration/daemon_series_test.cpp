// Real time series under a real daemon.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "palpate/v1/series.grpc.pb.h"
#include "tests/support/daemon.h"
#include "tests/support/data_folder.h"
#include "tests/support/excuse.h"
#include "tests/support/nrrd.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

namespace fs = std::filesystem;

class SeriesTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:bumps:32"});
    series_ = v1::SeriesService::NewStub(daemon_->channel());
  }
  static void TearDownTestSuite() {
    series_.reset();
    daemon_.reset();
  }

  static fs::path Data(const std::string& name) {
    return testing::DataFolder() / "timeseries" / name;
  }
  grpc::Status Load(const std::vector<std::string>& sources) {
    v1::LoadSeriesRequest request;
    for (const std::string& source : sources) request.add_sources(source);
    return Load(request);
  }
  grpc::Status Load(const v1::LoadSeriesRequest& request) {
    grpc::ClientContext context;
    auto reader = series_->LoadSeries(&context, request);
    progress_ = 0;
    for (v1::LoadSeriesResponse event; reader->Read(&event);) {
      if (event.has_result()) result_ = event.result();
      progress_ += event.has_progress();
    }
    return reader->Finish();
  }
  grpc::Status Control(const v1::ControlSeriesRequest& request) {
    grpc::ClientContext context;
    v1::ControlSeriesResponse response;
    const grpc::Status status = series_->ControlSeries(&context, request, &response);
    state_ = response.series();
    return status;
  }
  grpc::Status Get() {
    grpc::ClientContext context;
    v1::GetSeriesResponse response;
    const grpc::Status status = series_->GetSeries(&context, {}, &response);
    state_ = response.series();
    return status;
  }
  static v1::VolumeDescription Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.volume();
  }
  static ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  static std::unique_ptr<Daemon> daemon_;
  static std::unique_ptr<v1::SeriesService::Stub> series_;
  v1::LoadSeriesResult result_;
  v1::SeriesState state_;
  int progress_ = 0;
};
std::unique_ptr<Daemon> SeriesTest::daemon_;
std::unique_ptr<v1::SeriesService::Stub> SeriesTest::series_;

TEST_F(SeriesTest, PlaysARealSeriesFrameByFrame) {
  if (!fs::exists(Data("viscous_64x64x64_float32_t010.nrrd"))) GTEST_SKIP() << "no data";
  v1::LoadSeriesRequest request;
  request.add_sources(Data("viscous_*.nrrd"));
  request.mutable_options()->set_isovalue(35.0);
  const grpc::Status status = Load(request);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(result_.series().frames(), 9u);
  EXPECT_FALSE(result_.series().playing());
  EXPECT_EQ(result_.volume().frames(), 9u);
  EXPECT_GE(progress_, 9);
  EXPECT_GT(result_.series().memory_bytes(), 9u * 64 * 64 * 64);

  PoseCollector poses(*daemon_);
  ASSERT_TRUE(daemon_->WaitForTicks(200));
  v1::ControlSeriesRequest play;
  play.set_playing(true);
  play.set_rate_hz(4.0);
  ASSERT_TRUE(Control(play).ok());
  EXPECT_TRUE(state_.playing());
  ASSERT_TRUE(test::Eventually([&] { return Get().ok() && !state_.playing(); }));
  EXPECT_EQ(state_.position_frames(), 8.0);
  // The last frame is shown just after the state says so.
  const std::uint64_t last = result_.volume().volume_revision() + 8;
  // Frames whose time has passed are left out: fewer of them are a count.
  ASSERT_TRUE(test::Eventually([&] { return Volume().volume_revision() == last; }))
      << test::kBusyMachine;
  ASSERT_TRUE(daemon_->WaitForTicks(100));
  // Each frame is a revision, in order, and every tick has one.
  std::vector<std::uint64_t> revisions;
  for (const v1::PoseSample& sample : poses.Stop()) {
    if (revisions.empty() || revisions.back() != sample.volume_revision()) {
      revisions.push_back(sample.volume_revision());
    }
  }
  ASSERT_EQ(revisions.size(), 9u);
  for (std::size_t n = 0; n < revisions.size(); ++n) {
    EXPECT_EQ(revisions[n], result_.volume().volume_revision() + n);
  }
  EXPECT_EQ(Volume().loaded_revision(), result_.volume().volume_revision());
}

TEST_F(SeriesTest, OtherFormatsAndOneFileWithAllFrames) {
  if (!fs::exists(Data("nibabel_functional.nii"))) GTEST_SKIP() << "no data";
  ASSERT_TRUE(Load({Data("nibabel_functional.nii")}).ok());
  EXPECT_EQ(result_.series().frames(), 20u);
  EXPECT_NEAR(result_.volume().value_min(), 629.0, 1.0);
  EXPECT_NEAR(result_.volume().value_max(), 5572.0, 1.0);
  ASSERT_TRUE(Load({Data("isabel_*t30.nrrd"), Data("isabel_*t3[12].nrrd"),
                    Data("isabel_125x125x25_float64_t33.nrrd")})
                  .error_code() == grpc::StatusCode::INVALID_ARGUMENT);
  ASSERT_TRUE(Load({Data("isabel_*.nrrd")}).ok());
  EXPECT_EQ(result_.series().frames(), 4u);
  EXPECT_EQ(result_.volume().value_min(), 0.0);
  v1::ControlSeriesRequest request;
  request.set_interpolate(true);
  request.set_position_frames(1.5);
  ASSERT_TRUE(Control(request).ok());
  EXPECT_EQ(state_.position_frames(), 1.5);
}

TEST_F(SeriesTest, BadSeriesAndControlsAreRefused) {
  TemporaryFolder folder;
  const auto write = [&](const std::string& name, const Vec3i& size) {
    testing::WriteNrrd(folder.path() / name, size,
                       [](int i, int j, int) { return static_cast<float>(i * j); });
    return (folder.path() / name).string();
  };
  const std::string a = write("a1.nrrd", Vec3i(9, 8, 7));
  const std::string b = write("b1.nrrd", Vec3i(9, 8, 6));
  ASSERT_EQ(Run({"load", "builtin:bumps:16"}).exit_code, 0);
  const std::string before = Volume().SerializeAsString();
  const auto code = [&](const std::vector<std::string>& sources) {
    return Load(sources).error_code();
  };
  EXPECT_EQ(code({}), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code({a}), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code({a, b}), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code({a, "relative.nrrd"}), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code({(folder.path() / "c*").string()}), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code({a, (folder.path() / "c.nrrd").string()}), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(Volume().SerializeAsString(), before);

  ASSERT_TRUE(Load({a, a}).ok());
  v1::ControlSeriesRequest bad;
  bad.set_position_frames(1.5);
  EXPECT_EQ(Control(bad).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  bad.set_position_frames(std::nan(""));
  EXPECT_EQ(Control(bad).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  bad.clear_position_frames();
  bad.set_rate_hz(0.0);
  EXPECT_EQ(Control(bad).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  // Another volume ends the series.
  v1::LoadVolumeRequest other;
  other.set_source("builtin:sphere:16");
  grpc::ClientContext context;
  auto reader = daemon_->volume->LoadVolume(&context, other);
  for (v1::LoadVolumeResponse event; reader->Read(&event);) {
  }
  ASSERT_TRUE(reader->Finish().ok());
  EXPECT_EQ(Get().error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(Control({}).error_code(), grpc::StatusCode::ABORTED);
}

TEST_F(SeriesTest, TheClientPlays) {
  TemporaryFolder folder;
  for (int frame = 0; frame < 3; ++frame) {
    testing::WriteNrrd(folder.path() / ("t" + std::to_string(8 + frame) + ".nrrd"), Vec3i(9, 8, 7),
                       [&](int i, int j, int) { return static_cast<float>(i * j + frame); });
  }
  ProcessResult result = Run({"series", "load", folder.path() / "t*.nrrd"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("frame 0 of 0 to 2, paused at 10 frames/s"), std::string::npos)
      << result.output;
  EXPECT_NE(result.error.find("frame 3"), std::string::npos) << result.error;
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"rate", "-.5"}, {"loop", "on"}, {"interpolate", "on"}, {"seek", "1.5"}, {"play"}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.begin(), "series");
    result = Run(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.error;
  }
  EXPECT_NE(result.output.find("playing at -0.5 frames/s, in a loop, interpolated"),
            std::string::npos)
      << result.output;
  EXPECT_EQ(Run({"series", "pause"}).exit_code, 0);
  result = Run({"series", "info", "--json"});
  const auto json = nlohmann::json::parse(result.output);
  EXPECT_EQ(json["frames"], 3);
  EXPECT_EQ(json["playing"], false);
  EXPECT_EQ(json["rate_hz"], -0.5);
  EXPECT_EQ(Run({"series", "seek", "7"}).exit_code, 3);
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{},
                                             {"load"},
                                             {"seek"},
                                             {"seek", "x"},
                                             {"rate"},
                                             {"loop"},
                                             {"loop", "maybe"},
                                             {"play", "x"},
                                             {"stop"}}) {
    std::vector<std::string> arguments = wrong;
    arguments.insert(arguments.begin(), "series");
    EXPECT_EQ(Run(arguments).exit_code, 2);
  }
  EXPECT_EQ(Run({"load", "builtin:sphere:16"}).exit_code, 0);
  EXPECT_EQ(Run({"series", "info"}).exit_code, 7);
}

}  // namespace
}  // namespace palpate::test
