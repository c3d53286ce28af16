// Clients send volumes to a real daemon.
#include <gtest/gtest.h>
#include <zlib.h>

#include <fstream>

#include "tests/support/daemon.h"
#include "tests/support/data_folder.h"
#include "tests/support/nrrd.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

namespace fs = std::filesystem;

std::uint32_t Crc32(const std::string& bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

const std::string kVolume = testing::NrrdBytes(
    Vec3i(9, 8, 7), [](int i, int j, int k) { return static_cast<float>(i + 10 * j + 100 * k); });

class UploadTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(root_ / "up");
    std::ofstream(root_ / "palpated.toml")
        << "[volume]\nmax_upload_mib = 1\nupload_folder = \"" << (root_ / "up").string() << "\"\n";
    daemon_ = std::make_unique<Daemon>(
        test::kPalpated, std::vector<std::string>{"--config", root_ / "palpated.toml", "--volume",
                                                  "builtin:sphere:16"});
    before_ = Volume().SerializeAsString();
  }
  // Whatever happened, nothing is left.
  void TearDown() override { EXPECT_TRUE(NothingIsLeft()); }

  bool NothingIsLeft() const {
    for (int n = 0; n < 200; ++n) {
      if (fs::is_empty(root_ / "up")) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }
  v1::VolumeDescription Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.volume();
  }
  static v1::UploadVolumeStart StartOf(const std::string& name, const std::string& bytes) {
    v1::UploadVolumeStart start;
    start.set_name(name);
    start.set_size_bytes(bytes.size());
    start.set_crc32(Crc32(bytes));
    return start;
  }
  // One that is on its way.
  struct Call {
    explicit Call(Daemon& daemon) : writer(daemon.volume->UploadVolume(&context, &response)) {}
    bool Start(const v1::UploadVolumeStart& start) {
      v1::UploadVolumeRequest message;
      *message.mutable_start() = start;
      return writer->Write(message);
    }
    bool Data(const std::string& bytes) {
      v1::UploadVolumeRequest message;
      message.set_data(bytes);
      return writer->Write(message);
    }
    grpc::Status Finish() {
      writer->WritesDone();
      return writer->Finish();
    }
    grpc::ClientContext context;
    v1::UploadVolumeResponse response;
    std::unique_ptr<grpc::ClientWriter<v1::UploadVolumeRequest>> writer;
  };
  grpc::Status Upload(const v1::UploadVolumeStart& start, const std::string& bytes) {
    Call call(*daemon_);
    call.Start(start);
    for (std::size_t at = 0; at < bytes.size(); at += 1000) {
      if (!call.Data(bytes.substr(at, 1000))) break;
    }
    const grpc::Status status = call.Finish();
    response_ = call.response;
    return status;
  }
  void ExpectRefused(const v1::UploadVolumeStart& start, const std::string& bytes,
                     grpc::StatusCode code = grpc::StatusCode::INVALID_ARGUMENT) {
    const grpc::Status status = Upload(start, bytes);
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_EQ(status.error_message().find((root_ / "up").string()), std::string::npos)
        << status.error_message();
    EXPECT_EQ(Volume().SerializeAsString(), before_);
    EXPECT_TRUE(NothingIsLeft());
  }
  ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  TemporaryFolder folder_;
  const fs::path root_ = fs::canonical(folder_.path());
  std::unique_ptr<Daemon> daemon_;
  std::string before_;
  v1::UploadVolumeResponse response_;
};

TEST_F(UploadTest, TheVolumeIsTheOneThatWasSent) {
  v1::UploadVolumeStart start = StartOf("a.nrrd", kVolume);
  start.mutable_options()->set_isovalue(321.0);
  start.mutable_options()->set_source("/ignored");
  const grpc::Status status = Upload(start, kVolume);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(response_.volume().source(), "upload:a.nrrd");
  EXPECT_EQ(response_.volume().size_x(), 9u);
  EXPECT_EQ(response_.volume().value_max(), 678.0);
  EXPECT_GT(response_.applied_tick(), 0u);
  EXPECT_EQ(Volume().SerializeAsString(), response_.volume().SerializeAsString());
  grpc::ClientContext context;
  v1::GetSettingsResponse settings;
  daemon_->render->GetSettings(&context, {}, &settings);
  EXPECT_EQ(settings.settings().isovalue(), 321.0);
  EXPECT_EQ(settings.settings_revision(), response_.settings_revision());
}

TEST_F(UploadTest, AnotherSizeOrChecksumIsRefused) {
  const v1::UploadVolumeStart good = StartOf("a.nrrd", kVolume);
  v1::UploadVolumeStart bad = good;
  bad.set_crc32(good.crc32() + 1);
  ExpectRefused(bad, kVolume);
  std::string flipped = kVolume;
  flipped[kVolume.size() / 2] ^= 1;
  ExpectRefused(good, flipped);
  ExpectRefused(good, kVolume.substr(1));
  ExpectRefused(good, kVolume + "x");
  ExpectRefused(good, "");
  bad = good;
  bad.set_size_bytes(0);
  ExpectRefused(bad, kVolume);
}

TEST_F(UploadTest, BadNamesAndDataAreRefused) {
  for (const char* name :
       {"", ".", "..", "../a.nrrd", "/tmp/a.nrrd", "a/b.nrrd", "a.nhdr", "a.mhd", "a.txt", "a"}) {
    ExpectRefused(StartOf(name, kVolume), kVolume);
  }
  ExpectRefused(StartOf("a.nrrd", "no volume"), "no volume");
  const std::string truncated = kVolume.substr(0, kVolume.size() - 1);
  ExpectRefused(StartOf("a.nrrd", truncated), truncated);
  v1::UploadVolumeStart bad = StartOf("a.nrrd", kVolume);
  bad.mutable_options()->set_frame(1);
  ExpectRefused(bad, kVolume);
}

TEST_F(UploadTest, MessagesComeInOrder) {
  {
    Call call(*daemon_);
    call.Data(kVolume);
    EXPECT_EQ(call.Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  {
    Call call(*daemon_);
    EXPECT_EQ(call.Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  {
    Call call(*daemon_);
    call.Start(StartOf("a.nrrd", kVolume));
    call.Start(StartOf("a.nrrd", kVolume));
    EXPECT_EQ(call.Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  {
    const std::string large((1 << 20) + 1, 'x');
    Call call(*daemon_);
    v1::UploadVolumeStart start = StartOf("a.nrrd", large);
    start.set_size_bytes(1 << 20);
    call.Start(start);
    call.Data(large);
    EXPECT_EQ(call.Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  EXPECT_EQ(Volume().SerializeAsString(), before_);
}

TEST_F(UploadTest, TooLargeIsRefusedBeforeItIsSent) {
  v1::UploadVolumeStart start = StartOf("a.nrrd", kVolume);
  start.set_size_bytes((1 << 20) + 1);
  Call call(*daemon_);
  call.Start(start);
  const grpc::Status status = call.writer->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_NE(status.error_message().find("volume.max_upload_mib"), std::string::npos);
}

TEST_F(UploadTest, ACancelledUploadLeavesNothing) {
  for (const bool disconnect : {false, true}) {
    auto call = std::make_unique<Call>(*daemon_);
    ASSERT_TRUE(call->Start(StartOf("a.nrrd", kVolume)));
    ASSERT_TRUE(call->Data(kVolume.substr(0, 100)));
    for (int n = 0; n < 200 && fs::is_empty(root_ / "up"); ++n) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    EXPECT_FALSE(fs::is_empty(root_ / "up"));
    if (!disconnect) {
      call->context.TryCancel();
      EXPECT_EQ(call->writer->Finish().error_code(), grpc::StatusCode::CANCELLED);
    }
    call.reset();
    EXPECT_TRUE(NothingIsLeft());
  }
  EXPECT_EQ(Volume().SerializeAsString(), before_);
}

TEST_F(UploadTest, TwoAtOnceDoNotMeet) {
  const std::string other =
      testing::NrrdBytes(Vec3i(4, 4, 4), [](int i, int, int) { return static_cast<float>(i); });
  Call first(*daemon_);
  Call second(*daemon_);
  ASSERT_TRUE(first.Start(StartOf("a.nrrd", kVolume)));
  ASSERT_TRUE(second.Start(StartOf("a.nrrd", other)));
  ASSERT_TRUE(first.Data(kVolume.substr(0, 500)));
  ASSERT_TRUE(second.Data(other.substr(0, 50)));
  ASSERT_TRUE(first.Data(kVolume.substr(500)));
  ASSERT_TRUE(second.Data(other.substr(50)));
  EXPECT_TRUE(second.Finish().ok());
  EXPECT_EQ(Volume().size_x(), 4u);
  EXPECT_TRUE(first.Finish().ok());
  EXPECT_EQ(Volume().size_x(), 9u);
}

TEST_F(UploadTest, TheClientSendsFiles) {
  std::ofstream(root_ / "a.nrrd", std::ios::binary) << kVolume;
  ProcessResult result = Run({"upload", root_ / "a.nrrd", "--normalized-isovalue", "0.25"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("upload:a.nrrd"), std::string::npos) << result.output;
  EXPECT_NE(result.error.find("sending"), std::string::npos) << result.error;
  EXPECT_EQ(Volume().size_x(), 9u);
  EXPECT_EQ(Run({"upload", root_ / "absent.nrrd"}).exit_code, 4);
  EXPECT_EQ(Run({"upload", root_}).exit_code, 3);
  EXPECT_EQ(Run({"upload"}).exit_code, 2);
  std::ofstream(root_ / "empty.nrrd");
  EXPECT_EQ(Run({"upload", root_ / "empty.nrrd"}).exit_code, 3);
  std::ofstream(root_ / "large.nrrd") << std::string((1 << 20) + 1, 'x');
  result = Run({"upload", root_ / "large.nrrd"});
  EXPECT_EQ(result.exit_code, 6) << result.error;
  EXPECT_EQ(Volume().source(), "upload:a.nrrd");
  const std::string raw(2 * 3 * 4, '\1');
  std::ofstream(root_ / "b.dat") << raw << "\2" << raw.substr(1);
  result = Run({"upload", root_ / "b.dat", "--raw-size", "4,4,3", "--raw-type", "uint8"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(Volume().size_z(), 3u);
}

}  // namespace
}  // namespace palpate::test
