// What clients may have a real daemon load: folders, raw voxels, frames.
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/daemon.h"
#include "tests/support/data_folder.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

namespace fs = std::filesystem;

class LoadTest : public ::testing::Test {
 protected:
  // With a configuration file of `text`.
  void StartDaemon(const std::string& text) {
    std::ofstream(root_ / "palpated.toml") << text;
    daemon_ = std::make_unique<Daemon>(
        test::kPalpated,
        std::vector<std::string>{"--config", root_ / "palpated.toml", "--volume", first_volume_});
  }
  grpc::Status Load(const v1::LoadVolumeRequest& request) {
    grpc::ClientContext context;
    auto reader = daemon_->volume->LoadVolume(&context, request);
    for (v1::LoadVolumeResponse event; reader->Read(&event);) {
      if (event.has_result()) volume_ = event.result().volume();
    }
    return reader->Finish();
  }
  grpc::Status Load(const std::string& source) {
    v1::LoadVolumeRequest request;
    request.set_source(source);
    return Load(request);
  }
  v1::VolumeDescription Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.volume();
  }
  // 4 x 3 x 2 values 0 to 23 as uint16, after `offset` bytes.
  fs::path WriteRaw(const std::string& name, int offset, bool big_endian) {
    std::ofstream out(root_ / name, std::ios::binary);
    for (int n = 0; n < offset; ++n) out.put('x');
    for (char n = 0; n < 24; ++n) {
      out.put(big_endian ? '\0' : n);
      out.put(big_endian ? n : '\0');
    }
    return root_ / name;
  }
  static v1::LoadVolumeRequest RawRequest(const fs::path& path) {
    v1::LoadVolumeRequest request;
    request.set_source(path);
    request.mutable_raw()->set_size_x(4);
    request.mutable_raw()->set_size_y(3);
    request.mutable_raw()->set_size_z(2);
    request.mutable_raw()->set_type(v1::VOXEL_TYPE_UINT16);
    return request;
  }

  TemporaryFolder folder_;
  const fs::path root_ = fs::canonical(folder_.path());
  std::string first_volume_ = "builtin:sphere:16";
  std::unique_ptr<Daemon> daemon_;
  v1::VolumeDescription volume_;  // loaded last
};

// Its answer has five bytes of room.
TEST_F(LoadTest, AClientThatDoesNotReadHoldsNobody) {
  StartDaemon("");
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 5);
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  const auto stub = v1::VolumeService::NewStub(grpc::CreateCustomChannel(
      "unix:" + daemon_->socket().string(), grpc::InsecureChannelCredentials(), arguments));
  grpc::ClientContext context;
  v1::LoadVolumeRequest request;
  request.set_source("builtin:sphere:64");
  const auto reader = stub->LoadVolume(&context, request);
  EXPECT_TRUE(daemon_->process().WaitFor("it does not read its answer"));
  EXPECT_TRUE(Eventually([&] { return Load("builtin:sphere:32").ok(); }));
  context.TryCancel();
}

TEST_F(LoadTest, RawVoxelsAsStated) {
  StartDaemon("");
  for (const bool big_endian : {false, true}) {
    v1::LoadVolumeRequest request = RawRequest(WriteRaw("a.dat", 5, big_endian));
    request.mutable_raw()->set_offset_bytes(5);
    request.mutable_raw()->set_big_endian(big_endian);
    const grpc::Status status = Load(request);
    ASSERT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(volume_.size_x(), 4u);
    EXPECT_EQ(volume_.size_y(), 3u);
    EXPECT_EQ(volume_.size_z(), 2u);
    EXPECT_EQ(volume_.value_min(), 0.0);
    EXPECT_EQ(volume_.value_max(), 23.0);
    EXPECT_EQ(volume_.original_type(), "uint16");
  }
}

TEST_F(LoadTest, BadStatementsAboutRawVoxelsAreRefused) {
  StartDaemon("");
  const v1::LoadVolumeRequest good = RawRequest(WriteRaw("a.dat", 0, false));
  const std::string before = Volume().SerializeAsString();
  const auto expect_refused = [&](const std::function<void(v1::LoadVolumeRequest&)>& spoil) {
    v1::LoadVolumeRequest bad = good;
    spoil(bad);
    const grpc::Status status = Load(bad);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT)
        << bad.ShortDebugString() << ": " << status.error_message();
  };
  expect_refused([](auto& r) { r.mutable_raw()->clear_type(); });
  expect_refused([](auto& r) { r.mutable_raw()->set_type(static_cast<v1::VoxelType>(77)); });
  expect_refused([](auto& r) { r.mutable_raw()->set_type(v1::VOXEL_TYPE_UINT8); });
  expect_refused([](auto& r) { r.mutable_raw()->set_size_z(3); });
  expect_refused([](auto& r) { r.mutable_raw()->set_size_x(0); });
  expect_refused([](auto& r) { r.mutable_raw()->set_offset_bytes(1); });
  expect_refused([](auto& r) { r.mutable_raw()->set_offset_bytes(std::uint64_t{1} << 63); });
  expect_refused([](auto& r) { r.set_frame(1); });
  expect_refused([](auto& r) { r.set_source("builtin:bumps:16"); });
  expect_refused([](auto& r) { r.clear_raw(); });
  EXPECT_EQ(Volume().SerializeAsString(), before);
  EXPECT_TRUE(Load(good).ok());
}

TEST_F(LoadTest, OneFrameOfAFile) {
  const fs::path file = testing::DataFolder() / "timeseries/nibabel_functional.nii";
  if (!fs::exists(file)) GTEST_SKIP() << file << " is missing";
  StartDaemon("");
  v1::LoadVolumeRequest request;
  request.set_source(file);
  std::vector<double> greatest;
  for (const std::uint32_t frame : {0u, 19u}) {
    request.set_frame(frame);
    const grpc::Status status = Load(request);
    ASSERT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(volume_.frames(), 20u);
    greatest.push_back(volume_.value_max());
  }
  EXPECT_NE(greatest[0], greatest[1]);
  request.set_frame(20);
  EXPECT_EQ(Load(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.set_frame(0xffffffffu);
  EXPECT_EQ(Load(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(LoadTest, ClientsLoadFromTheConfiguredFoldersOnly) {
  fs::create_directory(root_ / "in");
  fs::create_directory(root_ / "out");
  const std::string nrrd =
      "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nspacings: 1 1 1\nencoding: raw\n\n"
      "abcdefgh";
  for (const char* name : {"in/a.nrrd", "out/b.nrrd"}) std::ofstream(root_ / name) << nrrd;
  fs::create_symlink(root_ / "out/b.nrrd", root_ / "in/link.nrrd");
  // The first volume is the daemon's own business.
  first_volume_ = root_ / "out/b.nrrd";
  StartDaemon("[volume]\nload_folders = [\"" + (root_ / "in").string() + "\"]\n");
  EXPECT_EQ(Volume().source(), first_volume_);
  const std::string before = Volume().SerializeAsString();
  for (const char* bad : {"out/b.nrrd", "in/link.nrrd", "in/../out/b.nrrd", "out/absent.nrrd"}) {
    const grpc::Status status = Load((root_ / bad).string());
    EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED) << bad;
    EXPECT_NE(status.error_message().find((root_ / "in").string()), std::string::npos);
    EXPECT_NE(status.error_message().find("volume.load_folders"), std::string::npos);
  }
  EXPECT_EQ(Load(root_ / "in/absent.nrrd").error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(Load("in/a.nrrd").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Load("").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Volume().SerializeAsString(), before);
  EXPECT_TRUE(Load(root_ / "in/a.nrrd").ok());
  EXPECT_TRUE(Load("builtin:bumps:16").ok());
}

}  // namespace
}  // namespace palpate::test
