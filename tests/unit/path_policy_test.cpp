// Which files clients may name.
#include "server/client_paths/path_policy.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// The line of an Error of this kind.
std::string RefusalLine(ErrorKind kind, const std::function<void()>& call) {
  const std::string line = testing::Complaint(call);
  EXPECT_EQ(testing::Refusal(call), kind) << line;
  EXPECT_EQ(line.find('\n'), std::string::npos);
  return line;
}

// What a refusal says besides the path, which it begins with.
std::string WithoutPath(const std::string& refusal, const std::string& path) {
  EXPECT_TRUE(refusal.starts_with(path)) << refusal;
  return refusal.substr(std::min(path.size(), refusal.size()));
}

class PathPolicyTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"load", "load/deep", "loads", "save", "outside"}) {
      fs::create_directory(root_ / name);
    }
    for (const char* name : {"load/a.nrrd", "outside/secret.nrrd", "save/old.vdb"}) {
      std::ofstream(root_ / name) << "x";
    }
    policy_ = PathPolicy({.load_folders = {root_ / "load"}, .save_folders = {root_ / "save"}});
  }
  std::string In(const std::string& name) const { return root_ / name; }
  std::string LoadRefusal(const std::string& path, ErrorKind kind = ErrorKind::kPermissionDenied) {
    SCOPED_TRACE(path);
    return RefusalLine(kind, [&] { policy_.CheckLoad(path); });
  }
  std::string SaveRefusal(const std::string& path, ErrorKind kind = ErrorKind::kPermissionDenied) {
    SCOPED_TRACE(path);
    return RefusalLine(kind, [&] { policy_.CheckSave(path); });
  }

  test::TemporaryFolder folder_;
  fs::path root_ = fs::canonical(folder_.path());
  PathPolicy policy_;
};

TEST_F(PathPolicyTest, LoadsFromItsFoldersAndWhatIsBelow) {
  EXPECT_EQ(policy_.CheckLoad(In("load/a.nrrd")), In("load/a.nrrd"));
  EXPECT_EQ(policy_.CheckLoad(In("load/deep")), In("load/deep"));
  EXPECT_EQ(policy_.CheckLoad(In("load")), In("load"));
  EXPECT_EQ(policy_.CheckLoad(In("load//deep/../a.nrrd")), In("load/a.nrrd"));
  EXPECT_EQ(policy_.CheckLoad(In("outside/../load/./a.nrrd")), In("load/a.nrrd"));
  // Who opens it says that it is not there.
  EXPECT_EQ(policy_.CheckLoad(In("load/absent.nrrd")), In("load/absent.nrrd"));
  EXPECT_EQ(policy_.CheckLoad("builtin:bumps:32"), "builtin:bumps:32");
}

TEST_F(PathPolicyTest, LoadsWhatWasSaved) {
  EXPECT_EQ(policy_.CheckLoad(In("save/old.vdb")), In("save/old.vdb"));
  EXPECT_NE(policy_.OpenToLoad(In("save/old.vdb")), nullptr);
  EXPECT_EQ(policy_.load_folders(), (std::vector<fs::path>{root_ / "load", root_ / "save"}));
}

TEST_F(PathPolicyTest, RefusesToLoadFromElsewhere) {
  for (const char* path : {"outside/secret.nrrd", "outside/absent", "load/../outside/secret.nrrd",
                           "loads", "loads/a.nrrd", "", "load/absent/../../x"}) {
    LoadRefusal(In(path));
  }
  LoadRefusal("/");
  LoadRefusal("/etc/passwd");
  LoadRefusal("/proc/self/root" + In("outside/secret.nrrd"));
}

TEST_F(PathPolicyTest, NamesTheFoldersAndTheKeyButNotWhatIsThere) {
  const std::string to_load = LoadRefusal(In("outside/secret.nrrd"));
  const std::string to_save = SaveRefusal(In("load/a.nrrd"));
  for (const std::string& name : {In("load"), std::string("volume.load_folders")}) {
    EXPECT_NE(to_load.find(name), std::string::npos) << to_load;
  }
  for (const std::string& name : {In("save"), std::string("volume.save_folders")}) {
    EXPECT_NE(to_save.find(name), std::string::npos) << to_save;
  }
  // Nothing but the path itself tells a file that is there from one that is not.
  const auto load = [&](const std::string& path) { return WithoutPath(LoadRefusal(path), path); };
  const auto save = [&](const std::string& path) { return WithoutPath(SaveRefusal(path), path); };
  EXPECT_EQ(load(In("outside/absent.nrrd")), load(In("outside/secret.nrrd")));
  EXPECT_EQ(load(In("none/secret.nrrd")), load(In("outside/secret.nrrd")));
  EXPECT_EQ(save(In("outside/absent.nrrd")), save(In("outside/secret.nrrd")));
  EXPECT_EQ(save(In("outside/none/x")), save(In("outside/x")));
  EXPECT_EQ(save(In("outside/secret.nrrd/x")), save(In("outside/x")));
  EXPECT_EQ(save(In("outside")), save(In("outside/x")));
}

TEST_F(PathPolicyTest, RefusesPathsThatAreNone) {
  for (const std::string& path :
       {std::string(), std::string("a.nrrd"), std::string("./a.nrrd"), std::string("../a.nrrd"),
        In("load/a.nrrd") + '\0' + ".vdb", In("load/a\nforged.nrrd"), In("load/\x1b[2J"),
        std::string("/") + std::string(5000, 'a')}) {
    LoadRefusal(path, ErrorKind::kInvalidArgument);
    SaveRefusal(path, ErrorKind::kInvalidArgument);
  }
  // Only a source to load can be built in; here it is a relative path.
  SaveRefusal("builtin:bumps", ErrorKind::kInvalidArgument);
}

TEST_F(PathPolicyTest, FollowsLinksBeforeItJudges) {
  fs::create_symlink(root_ / "outside", root_ / "load/way_out");
  fs::create_symlink(root_ / "outside/secret.nrrd", root_ / "load/link.nrrd");
  fs::create_symlink("../outside", root_ / "load/relative_way_out");
  fs::create_symlink(root_ / "load", root_ / "outside/way_in");
  LoadRefusal(In("load/way_out/secret.nrrd"));
  LoadRefusal(In("load/way_out/absent.nrrd"));
  LoadRefusal(In("load/link.nrrd"));
  LoadRefusal(In("load/relative_way_out/secret.nrrd"));
  // ".." of a link is the parent of where it leads.
  LoadRefusal(In("load/way_out/../load/../outside/secret.nrrd"));
  EXPECT_EQ(policy_.CheckLoad(In("outside/way_in/a.nrrd")), In("load/a.nrrd"));
  EXPECT_EQ(policy_.CheckLoad(In("load/way_out/../load/a.nrrd")), In("load/a.nrrd"));
}

TEST_F(PathPolicyTest, RefusesLinksInACircle) {
  fs::create_symlink(root_ / "load/b", root_ / "load/a");
  fs::create_symlink(root_ / "load/a", root_ / "load/b");
  LoadRefusal(In("load/a"), ErrorKind::kInvalidArgument);
  SaveRefusal(In("load/a/x"), ErrorKind::kInvalidArgument);
}

TEST_F(PathPolicyTest, SavesNewAndOldFiles) {
  EXPECT_EQ(policy_.CheckSave(In("save/new.vdb")), In("save/new.vdb"));
  EXPECT_EQ(policy_.CheckSave(In("save/old.vdb")), In("save/old.vdb"));
  EXPECT_EQ(policy_.CheckSave(In("load/../save/new.vdb")), In("save/new.vdb"));
  fs::create_symlink(root_ / "save/old.vdb", root_ / "save/link.vdb");
  EXPECT_EQ(policy_.CheckSave(In("save/link.vdb")), In("save/old.vdb"));
}

TEST_F(PathPolicyTest, RefusesToSaveElsewhere) {
  fs::create_symlink(root_ / "outside", root_ / "save/way_out");
  fs::create_symlink(root_ / "outside/secret.nrrd", root_ / "save/link.vdb");
  for (const char* path :
       {"outside/x.vdb", "load/a.nrrd", "save/../outside/x.vdb", "save/way_out/x.vdb",
        "save/link.vdb", "save/none/../../outside/x.vdb", "saves/x.vdb"}) {
    SaveRefusal(In(path));
  }
}

TEST_F(PathPolicyTest, SavesToNothingButRegularFiles) {
  fs::create_directory(root_ / "save/folder");
  ASSERT_EQ(mkfifo(In("save/pipe").c_str(), 0600), 0);
  fs::create_symlink(root_ / "save/folder", root_ / "save/to_folder");
  fs::create_symlink(root_ / "outside/to_come.vdb", root_ / "save/dangling.vdb");
  for (const char* path :
       {"save", "save/", "save/.", "save/..", "save/folder/", "save/new.vdb/", "save/to_folder"}) {
    EXPECT_THROW(policy_.CheckSave(In(path)), Error) << path;
  }
  for (const char* path : {"save/pipe", "save/folder", "save/dangling.vdb"}) {
    SaveRefusal(In(path), ErrorKind::kInvalidArgument);
  }
  SaveRefusal(In("save/none/x.vdb"), ErrorKind::kNotFound);
  SaveRefusal(In("save/old.vdb/x.vdb"), ErrorKind::kNotFound);
}

TEST_F(PathPolicyTest, FoldersAreCheckedAtStart) {
  for (const fs::path& bad : {fs::path("relative"), fs::path(""), root_ / "absent",
                              root_ / "load/a.nrrd", fs::path(std::string("/tmp\0x", 6))}) {
    RefusalLine(ErrorKind::kInvalidArgument, [&] { PathPolicy({.load_folders = {bad}}); });
    RefusalLine(ErrorKind::kInvalidArgument, [&] { PathPolicy({.save_folders = {bad}}); });
  }
}

TEST_F(PathPolicyTest, AFolderMayBeALinkAndEndWithASlash) {
  fs::create_symlink(root_ / "load", root_ / "entrance");
  const PathPolicy policy({.load_folders = {root_ / "entrance/"}, .save_folders = {"/"}});
  EXPECT_EQ(policy.CheckLoad(In("load/a.nrrd")), In("load/a.nrrd"));
  EXPECT_EQ(policy.CheckLoad(In("entrance/a.nrrd")), In("load/a.nrrd"));
  EXPECT_EQ(policy.CheckSave(In("outside/x.vdb")), In("outside/x.vdb"));
}

// Whatever the lists say, and under any name.
TEST_F(PathPolicyTest, FilesOfItsOwnAreNeitherLoadedNorSavedTo) {
  std::ofstream(root_ / "save/key.pem") << "secret";
  fs::create_directories(root_ / "load/state/deep");
  std::ofstream(root_ / "load/state/deep/a.toml") << "secret";
  fs::create_hard_link(root_ / "save/key.pem", root_ / "load/hard.raw");
  fs::create_hard_link(root_ / "load/state/deep/a.toml", root_ / "save/hard.raw");
  fs::create_symlink(root_ / "save/key.pem", root_ / "load/soft.raw");
  fs::create_directory_symlink(root_ / "load/state", root_ / "load/soft");
  policy_ = PathPolicy({.load_folders = {"/"},
                        .save_folders = {"/"},
                        .own_files = OwnFiles({root_ / "save/key.pem", root_ / "load/state"})});
  for (const char* own :
       {"save/key.pem", "load/hard.raw", "save/hard.raw", "load/soft.raw", "load/state/deep/a.toml",
        "load/state/new.vdb", "load/soft/new.vdb", "load/state"}) {
    LoadRefusal(In(own));
    SaveRefusal(In(own));
  }
  LoadRefusal("/proc/self/environ");
  LoadRefusal("/sys/kernel/notes");
  EXPECT_EQ(policy_.CheckLoad(In("load/a.nrrd")), In("load/a.nrrd"));
  EXPECT_EQ(policy_.CheckLoad(In("load")), In("load"));
  EXPECT_EQ(policy_.CheckSave(In("save/new.vdb")), In("save/new.vdb"));
}

TEST_F(PathPolicyTest, ByDefaultLoadsAndSavesNothing) {
  policy_ = PathPolicy();
  EXPECT_NE(LoadRefusal(In("load/a.nrrd")).find("volume.load_folders"), std::string::npos);
  EXPECT_NE(SaveRefusal(In("save/x.vdb")).find("volume.save_folders"), std::string::npos);
  EXPECT_EQ(CurrentFolder(), fs::current_path());
}

TEST_F(PathPolicyTest, OpensWhatMayBeLoaded) {
  std::string text;
  *policy_.OpenToLoad(In("load/a.nrrd")) >> text;
  EXPECT_EQ(text, "x");
  const auto refusal = [&](ErrorKind kind, const std::string& name) {
    return RefusalLine(kind, [&] { policy_.OpenToLoad(In(name)); });
  };
  refusal(ErrorKind::kPermissionDenied, "outside/secret.nrrd");
  refusal(ErrorKind::kNotFound, "load/absent");
  refusal(ErrorKind::kInvalidArgument, "load/deep");
  ASSERT_EQ(mkfifo(In("load/pipe").c_str(), 0600), 0);
  refusal(ErrorKind::kInvalidArgument, "load/pipe");
}

// A folder and a link that leads out change places without end, on another thread.
class Swapping {
 public:
  Swapping(const fs::path& folder, const fs::path& link)
      : thread_([=, this] {
          while (!stop_) {
            renameat2(AT_FDCWD, folder.c_str(), AT_FDCWD, link.c_str(), RENAME_EXCHANGE);
          }
        }) {}
  ~Swapping() {
    stop_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

TEST_F(PathPolicyTest, NothingOutsideIsOpenedWhereALinkComesAfterTheLook) {
  std::ofstream(root_ / "load/deep/secret.nrrd") << "inside";
  std::ofstream(root_ / "outside/secret.nrrd") << "outside";
  fs::create_symlink(root_ / "outside", root_ / "load/link");
  const Swapping swapping(root_ / "load/deep", root_ / "load/link");
  int read = 0;
  for (int n = 0; n < 20'000; ++n) {
    try {
      std::string text;
      *policy_.OpenToLoad(In("load/deep/secret.nrrd")) >> text;
      ASSERT_EQ(text, "inside") << n;
      ++read;
    } catch (const Error&) {
      // The link was there, or came.
    }
  }
  EXPECT_GT(read, 0);
}

TEST_F(PathPolicyTest, NothingOutsideIsWrittenWhereALinkComesAfterTheLook) {
  fs::create_directory(root_ / "save/deep");
  fs::create_symlink(root_ / "outside", root_ / "save/link");
  {
    const Swapping swapping(root_ / "save/deep", root_ / "save/link");
    for (int n = 0; n < 2'000; ++n) {
      try {
        const auto write = [](const fs::path& partial) { std::ofstream(partial) << "new"; };
        WriteWhole(policy_.CheckSave(In("save/deep/new.vdb")), write, IfThere::kReplace,
                   Durable::kNo, Links::kRefused);
      } catch (const Error&) {
      }
    }
  }
  for (const fs::directory_entry& entry : fs::directory_iterator(root_ / "outside")) {
    if (entry.path().filename() == "secret.nrrd") continue;
    // A name may be left that was made and could not be taken back; nothing is in it.
    EXPECT_TRUE(entry.path().string().ends_with(".partial")) << entry.path();
    EXPECT_EQ(entry.file_size(), 0u) << entry.path();
  }
}

}  // namespace
}  // namespace palpate
