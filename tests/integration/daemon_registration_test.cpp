// Clients move the volume of a real daemon, which keeps where it lies.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>

#include "tests/support/daemon.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

using Json = nlohmann::json;

void Set(v1::Vector3* vector, double x, double y, double z) {
  vector->set_x(x);
  vector->set_y(y);
  vector->set_z(z);
}

void SetTurnAboutY(v1::Quaternion* rotation, double degrees) {
  const double half_rad = degrees * std::numbers::pi / 360.0;
  rotation->set_w(std::cos(half_rad));
  rotation->set_y(std::sin(half_rad));
}

class DaemonRegistrationTest : public ::testing::Test {
 protected:
  void Start(const std::string& volume = "builtin:bumps:32", std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--volume", volume, "--state-folder", state_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    daemon_.reset();
    daemon_ = std::make_unique<Daemon>(test::kPalpated, arguments);
  }
  v1::GetRegistrationResponse Get() {
    grpc::ClientContext context;
    v1::GetRegistrationResponse response;
    EXPECT_TRUE(daemon_->registration->GetRegistration(&context, {}, &response).ok());
    return response;
  }
  grpc::Status Update(const v1::UpdateRegistrationRequest& request) {
    grpc::ClientContext context;
    updated_ = {};
    return daemon_->registration->UpdateRegistration(&context, request, &updated_);
  }
  v1::VolumeDescription Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.volume();
  }
  grpc::Status Load(const v1::LoadVolumeRequest& request) {
    grpc::ClientContext context;
    auto reader = daemon_->volume->LoadVolume(&context, request);
    for (v1::LoadVolumeResponse event; reader->Read(&event);) {
    }
    return reader->Finish();
  }
  grpc::Status Load(const std::string& source) {
    v1::LoadVolumeRequest request;
    request.set_source(source);
    return Load(request);
  }
  ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {test::kPalpate, "place"});
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  TemporaryFolder folder_;
  const std::string state_ = folder_.path() / "state";
  std::unique_ptr<Daemon> daemon_;
  v1::UpdateRegistrationResponse updated_;
};

TEST_F(DaemonRegistrationTest, MovesTheVolumeAtATick) {
  Start();
  const v1::GetRegistrationResponse before = Get();
  EXPECT_EQ(before.registration().rotation().w(), 1.0);
  v1::UpdateRegistrationRequest request;
  Set(request.mutable_translate_mm(), 10, -5, 2.5);
  SetTurnAboutY(request.mutable_rotate(), 90);
  request.set_scale_by(0.5);
  ASSERT_TRUE(Update(request).ok());
  const v1::Registration& now = updated_.registration();
  EXPECT_EQ(now.center_mm().x(), 10.0);
  EXPECT_EQ(now.center_mm().z(), 2.5);
  EXPECT_NEAR(now.rotation().y(), std::sqrt(0.5), 1e-15);
  EXPECT_EQ(now.device_mm_per_volume_mm(), 0.5 * before.registration().device_mm_per_volume_mm());
  EXPECT_EQ(now.device_mm_per_voxel(), now.device_mm_per_volume_mm());
  EXPECT_EQ(updated_.settings_revision(), before.settings_revision() + 1);
  EXPECT_GT(updated_.applied_tick(), 0u);
  EXPECT_EQ(Get().registration().SerializeAsString(), now.SerializeAsString());

  // As the volume is described.
  const v1::VolumeDescription volume = Volume();
  EXPECT_EQ(volume.device_from_world_rotation().SerializeAsString(),
            now.rotation().SerializeAsString());
  EXPECT_EQ(volume.device_mm_per_volume_mm(), now.device_mm_per_volume_mm());
  // The middle of the lattice, 15.5 voxels along each axis, is at the centre.
  const v1::AffineMap& map = volume.device_from_index();
  const double y_mm =
      15.5 * (map.linear(3) + map.linear(4) + map.linear(5)) + map.translation().y();
  EXPECT_NEAR(y_mm, -5.0, 1e-9);
}

TEST_F(DaemonRegistrationTest, BadUpdatesAreRefusedAndChangeNothing) {
  Start();
  const std::string before = Get().SerializeAsString();
  std::vector<v1::UpdateRegistrationRequest> bad(9);
  bad[0].set_device_mm_per_volume_mm(0.0);
  bad[1].set_device_mm_per_voxel(-1.0);
  bad[2].set_device_mm_per_voxel(2e6);
  bad[3].set_scale_by(std::nan(""));
  Set(bad[4].mutable_center_mm(), 0, 2e6, 0);
  Set(bad[5].mutable_translate_mm(), 0, 0, HUGE_VAL);
  bad[6].mutable_rotation()->set_w(2.0);
  bad[7].mutable_rotate();  // all zeros
  bad[8].set_reset(true);
  bad[8].set_scale_by(-1.0);
  for (std::size_t n = 0; n < bad.size(); ++n) {
    EXPECT_EQ(Update(bad[n]).error_code(), grpc::StatusCode::INVALID_ARGUMENT) << n;
  }
  v1::UpdateRegistrationRequest stale;
  stale.set_reset(true);
  stale.set_expected_revision(99);
  EXPECT_EQ(Update(stale).error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(Get().SerializeAsString(), before);
  stale.set_expected_revision(Get().settings_revision());
  EXPECT_TRUE(Update(stale).ok());
}

TEST_F(DaemonRegistrationTest, AVolumeLiesWhereItLayAlsoAfterARestart) {
  Start();
  v1::UpdateRegistrationRequest request;
  Set(request.mutable_center_mm(), 0.1, 20, 3);
  SetTurnAboutY(request.mutable_rotation(), 33);
  request.set_device_mm_per_voxel(0.7);
  ASSERT_TRUE(Update(request).ok());
  const std::string placed = Get().registration().SerializeAsString();

  ASSERT_TRUE(Load("builtin:gyroid:32").ok());
  EXPECT_NE(Get().registration().SerializeAsString(), placed);
  EXPECT_EQ(Get().registration().center_mm().y(), 0.0);
  ASSERT_TRUE(Load("builtin:bumps:32").ok());
  EXPECT_EQ(Get().registration().SerializeAsString(), placed);

  // Not that of another spacing, nor of another size.
  v1::LoadVolumeRequest load;
  load.set_source("builtin:bumps:32");
  Set(load.mutable_spacing_mm(), 1, 1, 2);
  ASSERT_TRUE(Load(load).ok());
  EXPECT_EQ(Get().registration().center_mm().y(), 0.0);

  EXPECT_EQ(daemon_->End().exit_code, 0);
  Start();
  EXPECT_EQ(Get().registration().SerializeAsString(), placed);
  // A scale that is asked for wins, and is kept.
  load.clear_spacing_mm();
  load.set_device_mm_per_volume_mm(0.25);
  ASSERT_TRUE(Load(load).ok());
  EXPECT_EQ(Get().registration().device_mm_per_volume_mm(), 0.25);
  EXPECT_EQ(Get().registration().center_mm().y(), 20.0);
  EXPECT_EQ(daemon_->End().exit_code, 0);
  Start();
  EXPECT_EQ(Get().registration().device_mm_per_volume_mm(), 0.25);
}

TEST_F(DaemonRegistrationTest, IsKeptEvenIfTheDaemonIsKilledLater) {
  Start();
  ASSERT_EQ(Run({"--move-mm", "1,2,3"}).exit_code, 0);
  const std::string placed = Get().registration().SerializeAsString();
  const std::string file = state_ + "/registrations.toml";
  for (int n = 0; n < 100 && !std::filesystem::exists(file); ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(daemon_->End(SIGKILL).exit_code, -SIGKILL);
  Start();
  EXPECT_EQ(Get().registration().SerializeAsString(), placed);
}

TEST_F(DaemonRegistrationTest, ADamagedFileStopsNothing) {
  std::filesystem::create_directories(state_);
  std::ofstream(state_ + "/registrations.toml") << "[[registration]]\nsource = ";
  Start();
  EXPECT_EQ(Get().registration().center_mm().x(), 0.0);
  ASSERT_EQ(Run({"--move-mm", "1,2,3"}).exit_code, 0);
  const ProcessResult end = daemon_->End();
  EXPECT_EQ(end.exit_code, 0);
  EXPECT_NE(end.error.find("is damaged"), std::string::npos) << end.error;
  EXPECT_TRUE(std::filesystem::exists(state_ + "/registrations.toml.damaged"));
  Start();
  EXPECT_EQ(Get().registration().center_mm().x(), 1.0);
}

TEST_F(DaemonRegistrationTest, TheClientPlacesAndShows) {
  Start();
  ProcessResult result = Run({});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("not turned"), std::string::npos) << result.output;
  result = Run({"--center-mm", "-.5,1,0", "--turn-deg", "z,-90", "--cells-per-mm", "4", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Json placed = Json::parse(result.output);
  EXPECT_EQ(placed["center_mm"], Json({-0.5, 1.0, 0.0}));
  EXPECT_NEAR(placed["rotation_wxyz"][3].get<double>(), -std::sqrt(0.5), 1e-15);
  EXPECT_EQ(placed["device_mm_per_voxel"], 0.25);
  EXPECT_GT(placed["applied_tick"], 0);
  const Json shown = Json::parse(Run({"--json"}).output);
  EXPECT_EQ(shown["center_mm"], placed["center_mm"]);
  EXPECT_EQ(shown["settings_revision"], placed["settings_revision"]);
  result = Run({"--reset"});
  EXPECT_NE(result.output.find("applied at tick"), std::string::npos) << result.output;
  EXPECT_EQ(Get().registration().center_mm().x(), 0.0);
  EXPECT_EQ(Run({"--device-mm-per-voxel", "1e7"}).exit_code, 3);
  EXPECT_EQ(Run({"--reset", "--expected-revision", "1"}).exit_code, 7);
}

// The simulated hand holds both buttons now and then.
TEST_F(DaemonRegistrationTest, TheStylusCarvesAndMovesTheVolume) {
  const std::string config = folder_.path() / "palpated.toml";
  std::ofstream(config) << "[device]\npressed_buttons = 3\n"
                           "[haptics]\ncarve_tool = true\ncarve_radius_mm = 6.0\n";
  Start("builtin:bumps:32", {"--config", config});
  const v1::VolumeDescription before = Volume();
  const auto wait_for = [](const std::function<bool()>& done) {
    for (int n = 0; n < 300 && !done(); ++n) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return done();
  };
  EXPECT_TRUE(wait_for([&] { return Volume().volume_revision() > before.volume_revision() + 5; }));
  EXPECT_EQ(Volume().loaded_revision(), before.loaded_revision());
  EXPECT_EQ(Get().registration().center_mm().x(), 0.0);

  const auto set_tools = [&](bool carve, bool clutch) {
    v1::UpdateSettingsRequest request;
    request.mutable_settings()->set_carve_tool(carve);
    request.mutable_settings()->set_clutch_tool(clutch);
    request.mutable_update_mask()->add_paths("carve_tool");
    request.mutable_update_mask()->add_paths("clutch_tool");
    grpc::ClientContext context;
    v1::UpdateSettingsResponse response;
    return daemon_->render->UpdateSettings(&context, request, &response);
  };
  ASSERT_TRUE(set_tools(false, true).ok());
  PoseCollector collector(*daemon_);
  EXPECT_TRUE(wait_for([&] { return Get().registration().center_mm().x() != 0.0; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  ASSERT_TRUE(set_tools(false, false).ok());
  const v1::Registration moved = Get().registration();
  long suspended = 0;
  for (const v1::PoseSample& sample : collector.Stop()) {
    if (sample.mode() != v1::PROXY_MODE_SUSPENDED) continue;
    ++suspended;
    EXPECT_EQ(std::hypot(sample.force_n().x(), sample.force_n().y(), sample.force_n().z()), 0.0);
    EXPECT_NE(sample.buttons() & 2u, 0u);
  }
  EXPECT_GT(suspended, 100);
  // Kept, as if a client had moved it; and it stays without the tool.
  EXPECT_EQ(daemon_->End().exit_code, 0);
  Start();
  EXPECT_EQ(Get().registration().SerializeAsString(), moved.SerializeAsString());
}

// The picture that a viewer draws moves with what is felt.
TEST_F(DaemonRegistrationTest, PosesNameTheRevisionsOfAMove) {
  Start();
  PoseCollector collector(*daemon_);
  v1::UpdateRegistrationRequest request;
  Set(request.mutable_translate_mm(), 0.5, 0, 0);
  std::vector<std::pair<std::uint64_t, std::uint64_t>> applied;
  for (int n = 0; n < 20; ++n) {
    ASSERT_TRUE(Update(request).ok());
    applied.emplace_back(updated_.settings_revision(), updated_.applied_tick());
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const std::vector<v1::PoseSample>& samples = collector.Stop();
  std::size_t seen = 0;
  for (std::size_t n = 1; n < samples.size(); ++n) {
    for (const auto& [revision, tick] : applied) {
      if (samples[n].settings_revision() != revision || samples[n].tick() != tick) continue;
      EXPECT_LT(samples[n - 1].settings_revision(), revision);
      ++seen;
    }
  }
  EXPECT_GE(seen + collector.dropped(), 15u);
}

}  // namespace
}  // namespace palpate::test
