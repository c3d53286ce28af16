// Voxels are changed, taken back and saved in a real daemon while it is felt, over
// gRPC; by the client: daemon_edit_client_test.cpp.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>

#include "common/wire/status.h"
#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

using grpc::StatusCode;

void Put(v1::Vector3* vector, double x, double y, double z) {
  vector->set_x(x);
  vector->set_y(y);
  vector->set_z(z);
}

v1::EditVolumeRequest Sphere(double x, double y, double z, double radius, double value,
                             v1::EditOperation operation = v1::EDIT_OPERATION_SET) {
  v1::EditVolumeRequest request;
  Put(request.mutable_sphere()->mutable_center(), x, y, z);
  request.mutable_sphere()->set_radius(radius);
  request.set_frame(v1::EDIT_FRAME_INDEX);
  request.set_operation(operation);
  request.set_value(value);
  return request;
}

v1::EditVolumeRequest Box(double low, double high, double value,
                          v1::EditOperation operation = v1::EDIT_OPERATION_SET) {
  v1::EditVolumeRequest request = Sphere(0, 0, 0, 1, value, operation);
  Put(request.mutable_box()->mutable_min(), low, low, low);
  Put(request.mutable_box()->mutable_max(), high, high, high);
  return request;
}

v1::EditVolumeRequest Block(std::uint32_t min, std::uint32_t size,
                            const std::vector<float>& values) {
  v1::EditVolumeRequest request;
  v1::DenseBlock& block = *request.mutable_block();
  block.set_min_x(min), block.set_min_y(min), block.set_min_z(min);
  block.set_size_x(size), block.set_size_y(size), block.set_size_z(size);
  block.set_values(values.data(), values.size() * sizeof(float));
  request.set_frame(v1::EDIT_FRAME_INDEX);
  request.set_operation(v1::EDIT_OPERATION_SET);
  return request;
}

class EditTest : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:bumps:64"});
  }

  grpc::Status Edit(const v1::EditVolumeRequest& request) {
    grpc::ClientContext context;
    last_ = {};
    return daemon_->volume->EditVolume(&context, request, &last_);
  }
  template <class Request>
  grpc::Status Call(grpc::Status (v1::VolumeService::Stub::*method)(grpc::ClientContext*,
                                                                    const Request&,
                                                                    v1::EditVolumeResponse*),
                    const Request& request = {}) {
    grpc::ClientContext context;
    last_ = {};
    return (*daemon_->volume.*method)(&context, request, &last_);
  }
  grpc::Status Undo() { return Call<v1::UndoEditRequest>(&v1::VolumeService::Stub::UndoEdit); }
  grpc::Status Redo() { return Call<v1::RedoEditRequest>(&v1::VolumeService::Stub::RedoEdit); }
  grpc::Status Revert() {
    return Call<v1::RevertVolumeRequest>(&v1::VolumeService::Stub::RevertVolume);
  }
  v1::VolumeDescription Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.volume();
  }
  struct SaveRun {
    grpc::Status status;
    int progress = 0;
    std::optional<v1::SaveVolumeResult> result;
  };
  SaveRun Save(const std::string& path, bool overwrite = false) {
    v1::SaveVolumeRequest request;
    request.set_path(path);
    request.set_overwrite(overwrite);
    grpc::ClientContext context;
    const auto reader = daemon_->volume->SaveVolume(&context, request);
    SaveRun run;
    for (v1::SaveVolumeResponse event; reader->Read(&event);) {
      run.progress += event.has_progress();
      if (event.has_result()) run.result = event.result();
    }
    run.status = reader->Finish();
    return run;
  }
  ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  std::unique_ptr<Daemon> daemon_;
  v1::EditVolumeResponse last_;
};

// Where a sample is told to be on the free side of the surface.
bool MustBeFree(const v1::PoseSample& sample) {
  return sample.mode() == v1::PROXY_MODE_FREE || sample.mode() == v1::PROXY_MODE_CONSTRAINED;
}

TEST_F(EditTest, AnEditOf512LeavesIsFeltFromOneTickOn) {
  PoseCollector collector(*daemon_);
  std::vector<std::pair<std::uint64_t, std::uint64_t>> applied;  // tick, volume revision
  for (int n = 0; n < 12; ++n) {
    v1::EditVolumeRequest all = Box(0, 63, n % 2 ? 0.8 : 0.2, v1::EDIT_OPERATION_PAINT);
    all.set_strength(0.05);
    ASSERT_TRUE(Edit(all).ok());
    EXPECT_GT(last_.changed_voxels(), 512u * 500u);
    applied.emplace_back(last_.applied_tick(), last_.volume_revision());
    ASSERT_TRUE(daemon_->WaitForTicks(30));
  }
  const std::vector<v1::PoseSample>& samples = collector.Stop();
  ASSERT_GT(samples.size(), 200u) << kBusyMachine;
  std::size_t wrong = 0, inside = 0, at_applied = 0;
  for (const v1::PoseSample& sample : samples) {
    std::uint64_t expected = 1;
    for (const auto& [tick, revision] : applied) {
      if (sample.tick() >= tick) expected = revision;
      at_applied += sample.tick() == tick;
    }
    wrong += sample.volume_revision() != expected;
    inside += MustBeFree(sample) && sample.density() > sample.isovalue();
  }
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(inside, 0u);
  EXPECT_GT(at_applied, 0u);
}

// Carves under the stylus where it touches, and puts matter where it is: the
// surface moves over the proxy, which is never left inside it.
TEST_F(EditTest, CarvingAndFillingAroundTheProxyNeverLeavesItInside) {
  PoseCollector collector(*daemon_);
  const v1::VolumeDescription volume = Volume();
  Eigen::Matrix4d X_DI = Eigen::Matrix4d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 3; ++col) {
      X_DI(row, col) = volume.device_from_index().linear(3 * row + col);
    }
  }
  X_DI(0, 3) = volume.device_from_index().translation().x();
  X_DI(1, 3) = volume.device_from_index().translation().y();
  X_DI(2, 3) = volume.device_from_index().translation().z();
  const Eigen::Matrix4d X_ID = X_DI.inverse();
  grpc::ClientContext context;
  auto stream = daemon_->poses->StreamPoses(&context);
  v1::StreamPosesRequest start;
  start.mutable_start()->set_rate_hz(50);
  start.mutable_start()->set_max_unacknowledged(1);
  ASSERT_TRUE(stream->Write(start));
  int edits = 0, felt = 0;
  v1::StreamPosesResponse message;
  for (int n = 0; n < 150 && stream->Read(&message); ++n) {
    const v1::PoseSample& sample = message.samples(0);
    v1::StreamPosesRequest acknowledge;
    acknowledge.mutable_acknowledgement()->set_message_number(message.message_number());
    ASSERT_TRUE(stream->Write(acknowledge));
    const Eigen::Vector4d p_I = X_ID * Eigen::Vector4d(sample.scp_h_mm().x(), sample.scp_h_mm().y(),
                                                       sample.scp_h_mm().z(), 1.0);
    if (p_I.head<3>().minCoeff() < 0.0 || p_I.head<3>().maxCoeff() > 63.0) continue;
    const bool fill = n % 5 == 4;
    ASSERT_TRUE(Edit(Sphere(p_I.x(), p_I.y(), p_I.z(), fill ? 2.0 : 3.0, 0.3,
                            fill ? v1::EDIT_OPERATION_ADD : v1::EDIT_OPERATION_SUBTRACT))
                    .ok());
    ++edits;
    felt += sample.contact();
  }
  context.TryCancel();
  stream->Finish();
  std::size_t inside = 0, faults = 0;
  for (const v1::PoseSample& sample : collector.Stop()) {
    inside += MustBeFree(sample) && sample.density() > sample.isovalue();
    faults += sample.mode() == v1::PROXY_MODE_FAULT;
  }
  EXPECT_GT(edits, 30);
  EXPECT_GT(felt, 5);
  EXPECT_EQ(inside, 0u);
  EXPECT_EQ(faults, 0u);
}

TEST_F(EditTest, TheReplySaysWhatChanged) {
  ASSERT_TRUE(Edit(Box(10, 13, 1.0)).ok());
  ASSERT_TRUE(Edit(Box(10, 12, 0.5)).ok());
  EXPECT_EQ(last_.volume_revision(), Volume().volume_revision());
  EXPECT_EQ(last_.changed_voxels(), 27u);
  EXPECT_EQ(last_.changed().min_x(), 10u);
  EXPECT_EQ(last_.changed().max_z(), 12u);
  EXPECT_EQ(last_.undo_steps(), 2u);
  EXPECT_EQ(last_.redo_steps(), 0u);
  EXPECT_GT(last_.applied_tick(), 0u);
  const std::uint64_t revision = last_.volume_revision();
  ASSERT_TRUE(Edit(Box(10, 12, 0.5)).ok());  // the same again
  EXPECT_EQ(last_.volume_revision(), revision);
  EXPECT_FALSE(last_.has_changed());
  EXPECT_EQ(last_.changed_voxels(), 0u);
  EXPECT_EQ(Volume().loaded_revision(), 1u);
}

TEST_F(EditTest, WorldIsMmAndIndexIsVoxels) {
  v1::LoadVolumeRequest load;
  load.set_source("builtin:bumps:64");
  Put(load.mutable_spacing_mm(), 0.5, 0.5, 2.0);
  grpc::ClientContext context;
  const auto reader = daemon_->volume->LoadVolume(&context, load);
  for (v1::LoadVolumeResponse event; reader->Read(&event);) {
  }
  ASSERT_TRUE(reader->Finish().ok());
  const v1::AffineMap map = Volume().world_from_index();
  const auto to_W = [&](double i, double j, double k) {
    return Sphere(map.linear(0) * i + map.translation().x(),
                  map.linear(4) * j + map.translation().y(),
                  map.linear(8) * k + map.translation().z(), 2.0, 1.0);
  };
  v1::EditVolumeRequest in_W = to_W(20, 21, 22);
  in_W.set_frame(v1::EDIT_FRAME_WORLD);
  ASSERT_TRUE(Edit(Box(0, 63, 0.5)).ok());
  ASSERT_TRUE(Edit(in_W).ok());
  EXPECT_EQ(last_.changed().min_x(), 16u);
  EXPECT_EQ(last_.changed().max_y(), 25u);
  EXPECT_EQ(last_.changed().min_z(), 21u);
  EXPECT_EQ(last_.changed().max_z(), 23u);
}

TEST_F(EditTest, BadEditsHaveTheirStatusAndChangeNothing) {
  ASSERT_TRUE(Edit(Box(1, 2, 0.7)).ok());
  const std::uint64_t revision = Volume().volume_revision();
  constexpr auto kBad = StatusCode::INVALID_ARGUMENT;
  const double nan = std::nan("");
  const v1::EditVolumeRequest good = Sphere(20, 20, 20, 5, 0.5);
  const auto spoilt = [&](const std::function<void(v1::EditVolumeRequest&)>& spoil) {
    v1::EditVolumeRequest request = good;
    spoil(request);
    return request;
  };
  const std::vector<float> eight(8, 0.5f);
  v1::EditVolumeRequest odd_bytes = Block(1, 2, eight);
  odd_bytes.mutable_block()->mutable_values()->pop_back();
  v1::EditVolumeRequest smooth_block = Block(1, 2, eight);
  smooth_block.set_operation(v1::EDIT_OPERATION_SMOOTH);
  v1::EditVolumeRequest world_block = Block(1, 2, eight);
  world_block.set_frame(v1::EDIT_FRAME_WORLD);
  v1::EditVolumeRequest faded_block = Block(1, 2, eight);
  faded_block.set_falloff(1.0);
  v1::EditVolumeRequest stale = good;
  stale.set_expected_revision(revision + 1);
  const std::vector<std::pair<v1::EditVolumeRequest, StatusCode>> cases = {
      {v1::EditVolumeRequest(), kBad},
      {spoilt([](auto& r) { r.clear_shape(); }), kBad},
      {spoilt([](auto& r) { r.clear_frame(); }), kBad},
      {spoilt([](auto& r) { r.set_frame(static_cast<v1::EditFrame>(9)); }), kBad},
      {spoilt([](auto& r) { r.clear_operation(); }), kBad},
      {spoilt([](auto& r) { r.set_operation(static_cast<v1::EditOperation>(77)); }), kBad},
      {spoilt([](auto& r) { r.mutable_sphere()->clear_center(); }), kBad},
      {spoilt([](auto& r) { r.mutable_sphere()->set_radius(0.0); }), kBad},
      {spoilt([](auto& r) { r.mutable_sphere()->set_radius(-3.0); }), kBad},
      {spoilt([&](auto& r) { r.mutable_sphere()->set_radius(nan); }), kBad},
      {spoilt([&](auto& r) { r.mutable_sphere()->mutable_center()->set_y(nan); }), kBad},
      {spoilt([](auto& r) { r.mutable_sphere()->mutable_center()->set_z(HUGE_VAL); }), kBad},
      {spoilt([](auto& r) { r.mutable_sphere()->mutable_center()->set_x(-500); }), kBad},
      {spoilt([&](auto& r) { r.set_value(nan); }), kBad},
      {spoilt([](auto& r) { r.set_value(1.5); }), kBad},
      {spoilt([](auto& r) { r.set_value(-0.1); }), kBad},
      {spoilt([](auto& r) { r.set_strength(0.0); }), kBad},
      {spoilt([](auto& r) { r.set_strength(1.5); }), kBad},
      {spoilt([](auto& r) { r.set_falloff(-1.0); }), kBad},
      {spoilt([&](auto& r) { r.set_falloff(nan); }), kBad},
      {Box(30, 20, 0.5), kBad},
      {Box(64, 80, 0.5), kBad},
      {spoilt([](auto& r) { r.mutable_box(); }), kBad},
      {spoilt([](auto& r) { Put(r.mutable_capsule()->mutable_to(), 5, 5, 5); }), kBad},
      {Block(63, 2, eight), kBad},
      {Block(1, 0, {}), kBad},
      {Block(1, 3, eight), kBad},
      {Block(4294967295u, 4294967295u, eight), kBad},
      {Block(1, 2, std::vector<float>(8, 2.0f)), kBad},
      {Block(1, 2, std::vector<float>(8, NAN)), kBad},
      {odd_bytes, kBad},
      {smooth_block, kBad},
      {world_block, kBad},
      {faded_block, kBad},
      {Block(0, 64, std::vector<float>((3 << 18) + 1, 0.5f)), StatusCode::RESOURCE_EXHAUSTED},
      {stale, StatusCode::ABORTED},
  };
  for (std::size_t n = 0; n < cases.size(); ++n) {
    const grpc::Status status = Edit(cases[n].first);
    EXPECT_EQ(status.error_code(), cases[n].second) << n << ": " << status.error_message();
    EXPECT_FALSE(status.error_message().empty()) << n;
    EXPECT_EQ(status.error_message().find('\n'), std::string::npos) << n;
    EXPECT_EQ(Volume().volume_revision(), revision) << n;
  }
  ASSERT_TRUE(Edit(good).ok());
  EXPECT_EQ(last_.undo_steps(), 2u);
}

TEST_F(EditTest, TheLargestBlockIsTaken) {
  ASSERT_EQ(Run({"load", "builtin:bumps:96"}).exit_code, 0);
  v1::EditVolumeRequest request = Block(0, 96, std::vector<float>(3 << 18, 0.25f));
  ASSERT_EQ(request.block().values().size(), std::size_t{3} << 20);
  request.mutable_block()->set_size_x(64);
  request.mutable_block()->set_size_z(128);  // sticks out
  EXPECT_EQ(Edit(request).error_code(), StatusCode::INVALID_ARGUMENT);
  request = Block(0, 96, std::vector<float>(96 * 96 * 85, 0.25f));
  request.mutable_block()->set_size_z(85);
  ASSERT_TRUE(Edit(request).ok());
  EXPECT_GT(last_.changed_voxels(), 500000u);
  EXPECT_EQ(last_.changed().max_z(), 84u);
}

TEST_F(EditTest, UndoRedoAndRevert) {
  EXPECT_EQ(Undo().error_code(), StatusCode::ABORTED);
  EXPECT_EQ(Redo().error_code(), StatusCode::ABORTED);
  ASSERT_TRUE(Edit(Box(10, 19, 1.0)).ok());
  ASSERT_TRUE(Edit(Box(10, 14, 0.0)).ok());
  EXPECT_EQ(last_.changed_voxels(), 125u);
  ASSERT_TRUE(Undo().ok());
  EXPECT_EQ(last_.volume_revision(), 4u);
  EXPECT_EQ(last_.changed_voxels(), 125u);
  EXPECT_EQ(last_.undo_steps(), 1u);
  EXPECT_EQ(last_.redo_steps(), 1u);
  ASSERT_TRUE(Redo().ok());
  EXPECT_EQ(last_.redo_steps(), 0u);
  ASSERT_TRUE(Revert().ok());
  EXPECT_EQ(last_.undo_steps(), 3u);
  EXPECT_EQ(last_.changed().max_x(), 19u);
  const std::uint64_t revision = last_.volume_revision();
  ASSERT_TRUE(Revert().ok());  // nothing is left to revert
  EXPECT_EQ(last_.volume_revision(), revision);
  v1::UndoEditRequest stale;
  stale.set_expected_revision(revision - 1);
  const grpc::Status status = Call<v1::UndoEditRequest>(&v1::VolumeService::Stub::UndoEdit, stale);
  EXPECT_EQ(status.error_code(), StatusCode::ABORTED);
  EXPECT_NE(status.error_message().find(std::to_string(revision)), std::string::npos);
  stale.set_expected_revision(revision);
  EXPECT_TRUE(Call<v1::UndoEditRequest>(&v1::VolumeService::Stub::UndoEdit, stale).ok());
  v1::RedoEditRequest redo;
  redo.set_expected_revision(revision);
  EXPECT_EQ(Call<v1::RedoEditRequest>(&v1::VolumeService::Stub::RedoEdit, redo).error_code(),
            StatusCode::ABORTED);
  v1::RevertVolumeRequest revert;
  revert.set_expected_revision(revision);
  EXPECT_EQ(
      Call<v1::RevertVolumeRequest>(&v1::VolumeService::Stub::RevertVolume, revert).error_code(),
      StatusCode::ABORTED);
  EXPECT_EQ(Run({"load", "builtin:sphere:32"}).exit_code, 0);
  EXPECT_EQ(Undo().error_code(), StatusCode::ABORTED);
}

TEST_F(EditTest, SavesAndLoadsAgain) {
  const TemporaryFolder folder;
  ASSERT_TRUE(Edit(Box(10, 19, 0.75)).ok());
  for (const char* name : {"a.vdb", "a.nrrd"}) {
    const std::string path = (folder.path() / name).string();
    const SaveRun run = Save(path);
    ASSERT_TRUE(run.status.ok()) << run.status.error_message();
    ASSERT_TRUE(run.result.has_value());
    EXPECT_GT(run.progress, 1);
    EXPECT_EQ(run.result->volume_revision(), 2u);
    EXPECT_EQ(run.result->size_bytes(), std::filesystem::file_size(path));
    EXPECT_EQ(Save(path).status.error_code(), StatusCode::ABORTED);
    EXPECT_TRUE(Save(path, true).status.ok());
  }
  // What was saved is what there is: setting the same again changes nothing.
  for (const char* name : {"a.vdb", "a.nrrd"}) {
    ASSERT_EQ(Run({"load", (folder.path() / name).string()}).exit_code, 0);
    const std::uint64_t revision = Volume().volume_revision();
    ASSERT_TRUE(Edit(Box(10, 19, 0.75)).ok());
    EXPECT_EQ(last_.volume_revision(), revision);
    ASSERT_TRUE(Edit(Box(9, 20, 0.75)).ok());
    EXPECT_GT(last_.changed_voxels(), 0u);
  }
}

TEST_F(EditTest, BadSavesHaveTheirStatusAndLeaveNothing) {
  const TemporaryFolder folder;
  const std::string good = (folder.path() / "a.vdb").string();
  for (const std::string& bad :
       {std::string(), std::string("a.vdb"), (folder.path() / "a.png").string(),
        folder.path().string(), good + '\0' + ".vdb"}) {
    EXPECT_EQ(Save(bad, true).status.error_code(), StatusCode::INVALID_ARGUMENT) << bad;
  }
  EXPECT_EQ(Save(folder.path() / "none" / "a.vdb").status.error_code(), StatusCode::NOT_FOUND);
  EXPECT_EQ(Save("/var/a.vdb").status.error_code(), StatusCode::PERMISSION_DENIED);
  // As on a disk that is full: files may not grow.
  const pid_t daemon = daemon_->process().pid();
  rlimit none{.rlim_cur = 100, .rlim_max = RLIM_INFINITY}, before{};
  ASSERT_EQ(prlimit(daemon, RLIMIT_FSIZE, &none, &before), 0);
  const grpc::Status full = Save(good).status;
  ASSERT_EQ(prlimit(daemon, RLIMIT_FSIZE, &before, nullptr), 0);
  EXPECT_EQ(full.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(FromStatus(full).kind(), ErrorKind::kDiskFull) << full.error_message();
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 0);
}

TEST_F(EditTest, ASaveIsOfOneRevisionWhileEditsGoOnAndCanBeCancelled) {
  const TemporaryFolder folder;
  ASSERT_EQ(Run({"load", "builtin:gyroid:200"}).exit_code, 0);
  v1::SaveVolumeRequest request;
  request.set_path((folder.path() / "a.nrrd").string());
  grpc::ClientContext context;
  const auto reader = daemon_->volume->SaveVolume(&context, request);
  v1::SaveVolumeResponse event;
  ASSERT_TRUE(reader->Read(&event));
  // The first tells that it is under way: no other one is begun, edits are made.
  EXPECT_EQ(Save((folder.path() / "b.vdb").string()).status.error_code(), StatusCode::ABORTED);
  ASSERT_TRUE(Edit(Box(70, 72, 0.5)).ok());
  EXPECT_EQ(last_.volume_revision(), 3u);
  context.TryCancel();
  while (reader->Read(&event)) {
  }
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::CANCELLED);
  // The daemon may still be about to end it.
  const auto empty = [&] { return std::filesystem::is_empty(folder.path()); };
  for (int n = 0; n < 1000 && !empty(); ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(empty());
  ASSERT_TRUE(Undo().ok());
  const SaveRun again = Save(request.path());
  ASSERT_TRUE(again.status.ok()) << again.status.error_message();
  EXPECT_EQ(again.result->volume_revision(), 4u);
}

}  // namespace
}  // namespace palpate::test
