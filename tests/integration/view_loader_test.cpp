// Opening and saving volumes from the viewer, with a real daemon.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "client/view/palpated/live_feed.h"
#include "tests/support/live_view.h"
#include "tests/support/nrrd.h"
#include "tests/support/restarted_daemon.h"
#include "tests/support/temporary_folder.h"

namespace palpate::view {
namespace {

using test::Follow;
using test::RestartedDaemon;
using test::TemporaryFolder;
using Outcome = VolumeLoader::Outcome;
using Result = VolumeLoader::Result;

class ViewLoader : public ::testing::Test {
 protected:
  explicit ViewLoader(std::vector<std::string> arguments = {"--volume", "builtin:bumps:32"})
      : daemon_(std::move(arguments)) {}
  void SetUp() override {
    daemon_.Start();
    feed_ = std::make_unique<LiveFeed>(
        client::ServerChoice{.address = {.socket_path = daemon_.socket()}});
    testing::WriteNrrd(file(), {6, 5, 4}, [](int x, int y, int z) { return x + y + 2.0f * z; });
    ASSERT_TRUE(Follow(*feed_, [&] { return feed_->volume().revision() && feed_->pose(); }));
  }

  std::filesystem::path file() const { return folder_.path() / "here.nrrd"; }
  VolumeLoader& loader() { return feed_->loader(); }
  Outcome Await() {
    std::optional<Outcome> outcome;
    EXPECT_TRUE(Follow(*feed_, [&] { return (outcome = loader().TakeOutcome()).has_value(); }));
    return outcome.value_or(Outcome{});
  }
  Outcome Load(const std::string& source, bool discard_edits = false) {
    loader().Load(source, discard_edits);
    return Await();
  }
  Outcome Save(const std::filesystem::path& path, SaveWhere where, bool overwrite = false) {
    loader().Save(path, where, overwrite);
    return Await();
  }
  bool Shows(const Vec3i& size) {
    return Follow(*feed_, [&] {
      return feed_->volume().lattice() && feed_->volume().lattice()->size == size;
    });
  }
  void Edit() {
    feed_->commands().Do("edit", [](client::Client& client) {
      client.Apply({.shape = client::Sphere{{0, 0, 0}, 1.0}, .value = 0.25});
    });
    EXPECT_TRUE(Follow(
        *feed_, [&] { return feed_->volume_info() && feed_->volume_info()->unsaved_edits == 1; }));
  }

  TemporaryFolder folder_;  // of the user
  RestartedDaemon daemon_;
  std::unique_ptr<LiveFeed> feed_;
};

// Its palpated reads only its own folder.
class ViewLoaderOfOthersFiles : public ViewLoader {
 protected:
  ViewLoaderOfOthersFiles()
      : ViewLoader({"--volume", "builtin:bumps:32", "--load-folder", "/usr"}) {}
};

TEST_F(ViewLoader, OpensAFileAndASample) {
  EXPECT_EQ(Load(file()).result, Result::kLoaded);
  EXPECT_TRUE(Shows({6, 5, 4}));
  EXPECT_EQ(feed_->volume().lattice()->source, file());
  EXPECT_EQ(Load("builtin:sphere:32").result, Result::kLoaded);
  EXPECT_TRUE(Shows({32, 32, 32}));
}

TEST_F(ViewLoaderOfOthersFiles, SendsAFileThatPalpatedMustNotRead) {
  EXPECT_EQ(Load(file()).result, Result::kLoaded);
  EXPECT_TRUE(Shows({6, 5, 4}));
  EXPECT_EQ(feed_->volume().lattice()->source, "upload:here.nrrd");
}

TEST_F(ViewLoader, ABadFileLeavesTheVolume) {
  std::ofstream(folder_.path() / "bad.nrrd") << "no volume";
  const std::string none = folder_.path() / "none.nrrd";
  for (const std::string& path : {(folder_.path() / "bad.nrrd").string(), none}) {
    const Outcome outcome = Load(path);
    EXPECT_EQ(outcome.result, Result::kFailed);
    EXPECT_FALSE(outcome.text.empty());
    EXPECT_EQ(outcome.text.find('\n'), std::string::npos);
    EXPECT_TRUE(Shows({32, 32, 32}));
  }
}

TEST_F(ViewLoader, ACancelledLoadLeavesTheVolume) {
  loader().Load("builtin:gyroid:500", false);
  ASSERT_TRUE(loader().running());
  loader().Cancel();
  EXPECT_EQ(Await().result, Result::kCancelled);
  EXPECT_FALSE(loader().running());
  EXPECT_TRUE(Shows({32, 32, 32}));
}

TEST_F(ViewLoader, EditsAreLostOnlyOnRequest) {
  Edit();
  const Outcome asked = Load(file());
  EXPECT_EQ(asked.result, Result::kUnsaved);
  EXPECT_EQ(asked.unsaved_edits, 1u);
  EXPECT_EQ(asked.path, file());
  EXPECT_TRUE(Shows({32, 32, 32}));
  EXPECT_EQ(Load(file(), true).result, Result::kLoaded);
  EXPECT_TRUE(Shows({6, 5, 4}));
}

// Where palpated can write, its own save counts: the edits are then saved.
TEST_F(ViewLoader, SavesHereByPalpatedOrByACopy) {
  for (const std::filesystem::path& folder : {folder_.path(), daemon_.folder()}) {
    Edit();
    for (const char* name : {"a.nrrd", "a.vdb"}) {
      EXPECT_EQ(Save(folder / name, SaveWhere::kHere).result, Result::kSaved);
      EXPECT_GT(std::filesystem::file_size(folder / name), 0u);
      EXPECT_EQ(Save(folder / name, SaveWhere::kHere).result, Result::kExists);
      EXPECT_EQ(Save(folder / name, SaveWhere::kHere, true).result, Result::kSaved);
    }
    const bool counts = folder == daemon_.folder();
    EXPECT_EQ(Load(folder / "a.nrrd").result, counts ? Result::kLoaded : Result::kUnsaved);
    EXPECT_EQ(Load("builtin:bumps:32", true).result, Result::kLoaded);
  }
}

TEST_F(ViewLoader, SavesThere) {
  EXPECT_EQ(Save(daemon_.folder() / "there.nrrd", SaveWhere::kThere).result, Result::kSaved);
  EXPECT_EQ(Save(folder_.path() / "a.nrrd", SaveWhere::kThere).result, Result::kFailed);
  EXPECT_EQ(Save(daemon_.folder() / "a.jpg", SaveWhere::kHere).result, Result::kFailed);
}

}  // namespace
}  // namespace palpate::view
