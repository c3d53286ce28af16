// `palpate download`: what it writes is the volume.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "common/error/error.h"
#include "server/volume/snapshot_builder.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using testing::EditableSession;

class DownloadTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_.Reserve();
    data_.Load("builtin:bumps:50");
    server_.Start();
  }
  test::ProcessResult Download(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(),
                     {test::kPalpate, "--socket", folder_.path() / "s", "download"});
    return test::Process(arguments).Wait();
  }
  // Of the file as the daemon would load it.
  LoadedVolume Read(const std::filesystem::path& file) const {
    const VolumeLoader loader{.import_program = test::kPalpateImport};
    std::vector<std::string> warnings;
    return loader.Load(
        {.source = file}, [](std::string_view, double) {}, [] { return false; }, warnings);
  }
  std::size_t FilesInFolder() const {
    const std::filesystem::directory_iterator files(files_.path());
    return static_cast<std::size_t>(std::distance(begin(files), end(files)));
  }

  test::TemporaryFolder folder_, files_;
  testing::ServedSession served_{folder_.path() / "s"};
  EditableSession& data_ = served_.data();
  RpcServer& server_ = served_.server();
  std::mt19937 random_{3};
};

TEST_F(DownloadTest, TheFileIsTheVolumeWithItsEdits) {
  const std::filesystem::path file = files_.path() / "copy.nrrd";
  for (int n = 0; n < 20; ++n) data_.RandomEdit(random_);
  const test::ProcessResult result = Download({file});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("50 x 50 x 50 voxels of builtin:bumps:50 at volume revision 21"),
            std::string::npos)
      << result.output;
  const LoadedVolume read = Read(file);
  const auto volume = data_.volume();
  EXPECT_EQ(read.metadata.size, volume->size());
  const AffineMap X_WI = read.metadata.WorldFromIndex();
  const AffineMap expected = volume->metadata().WorldFromIndex();
  EXPECT_LT((X_WI.linear - expected.linear).norm(), 1e-12);
  EXPECT_LT((X_WI.translation - expected.translation).norm(), 1e-12);
  EXPECT_EQ(read.bricks.content_hash(), volume->bricks().content_hash());
  EXPECT_EQ(FilesInFolder(), 1u);
}

TEST_F(DownloadTest, AFileIsReplacedOnlyWhenAsked) {
  const std::string file = files_.path() / "copy.nrrd";
  std::ofstream(file) << "mine";
  EXPECT_EQ(Download({file}).exit_code, ExitCode(ErrorKind::kConflict));
  EXPECT_EQ(std::filesystem::file_size(file), 4u);
  EXPECT_EQ(Download({file, "--overwrite"}).exit_code, 0);
  EXPECT_GT(std::filesystem::file_size(file), 50u * 50u * 50u * 4u);
  EXPECT_EQ(FilesInFolder(), 1u);
}

TEST_F(DownloadTest, BadPlacesAreRefusedInOneLine) {
  const auto expect = [&](const std::string& file, ErrorKind kind) {
    const test::ProcessResult result = Download({file});
    EXPECT_EQ(result.exit_code, ExitCode(kind)) << result.error;
    EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1) << result.error;
    EXPECT_TRUE(result.output.empty());
  };
  expect(files_.path() / "missing" / "copy.nrrd", ErrorKind::kNotFound);
  expect(files_.path(), ErrorKind::kInvalidArgument);
  EXPECT_EQ(Download({}).exit_code, kUsageExitCode);
  EXPECT_EQ(FilesInFolder(), 0u);
}

TEST_F(DownloadTest, ASignalLeavesNoFile) {
  data_.Load("builtin:gyroid:160");
  const std::string file = files_.path() / "copy.nrrd";
  test::Process process({test::kPalpate, "--socket", folder_.path() / "s", "download", file});
  ASSERT_TRUE(process.WaitFor("%"));
  process.Signal(SIGINT);
  const test::ProcessResult result = process.Wait();
  // Or it was done before.
  if (result.exit_code == 0) GTEST_SKIP() << "too fast to be interrupted";
  EXPECT_EQ(result.exit_code, ExitCode(ErrorKind::kCancelled)) << result.error;
  EXPECT_EQ(FilesInFolder(), 0u);
}

}  // namespace
}  // namespace palpate
