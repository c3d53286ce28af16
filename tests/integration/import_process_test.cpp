// ImportVolume: the daemon's side, with palpate-import and with programs that
// misbehave in its place.
#include "server/volume/load/import_process.h"

#include <fcntl.h>
#include <sys/wait.h>

#include <cerrno>
#include <cstdlib>
#include <fstream>

#include "common/error/error.h"
#include "common/files/descriptor.h"
#include "tests/integration/import_support.h"
#include "tests/support/places.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;

class ImportProcessTest : public ImportTest {
 protected:
  void SetUp() override {
    fs::create_directory(Path("tmp"));
    setenv("TMPDIR", Path("tmp").c_str(), 1);
    request_.import_program = test::kPalpateImport;
    request_.on_size = [this](const Vec3i& size, const LoadMemory& memory) {
      sizes_.emplace_back(size, memory.passing_bytes);
    };
    request_.source = Write("a.nrrd",
                            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 7 5 4\n"
                            "spacings: 1 1 1\nencoding: raw\n\n" +
                                PatternBytes<char>());
  }

  // Neither files nor processes are left, whatever happened.
  void TearDown() override {
    EXPECT_TRUE(fs::is_empty(Path("tmp")));
    EXPECT_TRUE(waitpid(-1, nullptr, WNOHANG) < 0 && errno == ECHILD);
    unsetenv("TMPDIR");
  }

  void UseScript(const std::string& script) {
    const fs::path path = Path("importer.sh");
    std::ofstream(path) << "#!/bin/sh\n" << script << "\n";
    fs::permissions(path, fs::perms::owner_all);
    request_.import_program = path;
  }

  Error Failure(const std::function<bool()>& cancelled = nullptr) {
    try {
      ImportVolume(request_, nullptr, cancelled);
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      return error;
    }
    ADD_FAILURE() << "imported";
    return Error(ErrorKind::kInternal, "");
  }

  ImportRequest request_;
  std::vector<std::pair<Vec3i, std::uint64_t>> sizes_;  // told, with the bytes on their way
};

TEST_F(ImportProcessTest, ReturnsTheVolumeAndReportsProgress) {
  double last = -1.0;
  std::vector<std::string> stages;
  const LoadedVolume volume = ImportVolume(
      request_,
      [&](std::string_view stage, double fraction) {
        EXPECT_GE(fraction, last);
        last = fraction;
        stages.emplace_back(stage);
      },
      [] { return false; });
  ExpectPattern(volume);
  EXPECT_EQ(last, 1.0);
  EXPECT_EQ(stages.front(), "checking");
  EXPECT_EQ(stages.back(), "loading");
}

TEST_F(ImportProcessTest, SpacingAndPathsWithDashesAndBlanks) {
  request_.spacing_mm = Vec3(0.1, 2.5, 1e-3);
  fs::rename(request_.source, Path("- a'b.nrrd"));
  request_.source = Path("- a'b.nrrd");
  EXPECT_EQ(ImportVolume(request_, nullptr, nullptr).metadata.spacing_mm, *request_.spacing_mm);
}

TEST_F(ImportProcessTest, TellsTheSizeInAdvanceAndEndsWhereThatThrows) {
  ImportVolume(request_, nullptr, nullptr);
  const std::pair told(Vec3i(7, 5, 4), DenseLoadMemory({7, 5, 4}, LeafType::kUint8).passing_bytes);
  EXPECT_EQ(sizes_, (std::vector{told, told}));  // before it is read, and before it is taken
  request_.on_size = [](const Vec3i&, const LoadMemory&) {
    throw Error(ErrorKind::kTooLarge, "no room");
  };
  EXPECT_EQ(Failure().what(), std::string("no room"));
  // An importer that goes on is killed.
  UseScript("echo 'size 7 5 4 1'\nexec sleep 100000");
  EXPECT_EQ(Failure().kind(), ErrorKind::kTooLarge);
}

TEST_F(ImportProcessTest, SizesThatAreNoneAreIgnored) {
  UseScript(
      "for s in 'size' 'size ' 'size 1 2 3' 'size 1 2 3 4 5' 'size 1 2 3 4 ' 'size 0 2 3 1' 'size "
      "-1 2 3 1' 'size 1 2 3 0' 'size 1 2 99999999999 1' 'size a b c d' 'size  1 2 3 1' "
      "'sizes 1 2 3 1' 'size 3 4 5 2'; do\n"
      "echo \"$s\"; done; exit 3");
  EXPECT_EQ(Failure().kind(), ErrorKind::kInvalidArgument);
  EXPECT_EQ(sizes_,
            (std::vector{std::pair(Vec3i(3, 4, 5),
                                   DenseLoadMemory({3, 4, 5}, LeafType::kInt16).passing_bytes)}));
}

// A taken-over importer.
TEST_F(ImportProcessTest, SizesDoNotWrapAndTakeNothingBack) {
  for (const char* size :
       {"2147483647 2147483647 2147483647 4", "2147483647 2147483647 2 4", "65536 65536 65536 1"}) {
    UseScript("echo 'size " + std::string(size) + "'\nexec sleep 100000");
    EXPECT_EQ(Failure().kind(), ErrorKind::kTooLarge) << size;
  }
  EXPECT_TRUE(sizes_.empty());
  UseScript("echo 'size 9 8 7 1'; echo 'size 2 2 2 1'; echo 'size 9 8 8 1'; exit 3");
  EXPECT_EQ(Failure().kind(), ErrorKind::kInvalidArgument);
  ASSERT_EQ(sizes_.size(), 2u);
  EXPECT_EQ(sizes_[0].first, Vec3i(9, 8, 7));
  EXPECT_EQ(sizes_[1].first, Vec3i(9, 8, 8));
}

TEST_F(ImportProcessTest, CancelAndTimeoutKillTheImporter) {
  UseScript("trap '' TERM INT\nexec sleep 100000");
  int asked = 0;
  EXPECT_EQ(Failure([&] { return ++asked > 3; }).kind(), ErrorKind::kCancelled);
  request_.timeout = seconds(0);
  EXPECT_EQ(Failure().kind(), ErrorKind::kTooLarge);
  // Closed pipes do not end the timeout.
  UseScript("exec sleep 100000 >&- 2>&-");
  EXPECT_EQ(Failure().kind(), ErrorKind::kTooLarge);
}

TEST_F(ImportProcessTest, EveryEndOfTheProgramHasAKind) {
  for (const auto& [script, kind] : {std::pair("kill -KILL $$", ErrorKind::kTooLarge),
                                     std::pair("kill -SEGV $$", ErrorKind::kInternal),
                                     std::pair("exit 3", ErrorKind::kInvalidArgument),
                                     std::pair("exit 77", ErrorKind::kInternal),
                                     // Without a volume.
                                     std::pair("exit 0", ErrorKind::kInvalidArgument)}) {
    UseScript(script);
    EXPECT_EQ(Failure().kind(), kind) << script;
  }
  UseScript(
      "echo 'palpate-import: warning: x: odd' >&2\necho 'palpate-import: x: bad' >&2\nexit 5");
  const Error error = Failure();
  EXPECT_EQ(error.kind(), ErrorKind::kPermissionDenied);
  EXPECT_STREQ(error.what(), "x: bad");
  request_.import_program = Path("none");
  EXPECT_EQ(Failure().kind(), ErrorKind::kInternal);
}

TEST_F(ImportProcessTest, FloodsAreBounded) {
  UseScript(
      "head -c 30000000 /dev/zero | tr '\\0' 'x' >&2\nyes 'progress 9e99 x' | head -n 200000\n"
      "yes 'palpate-import: x: bad' | head -n 200000 >&2\nexit 3");
  EXPECT_EQ(Failure().kind(), ErrorKind::kInvalidArgument);
}

TEST_F(ImportProcessTest, StdinIsEmptyAndNoDescriptorLeaks) {
  UseScript("cat; ls /proc/self/fd | wc -l | sed 's/^/palpate-import: /' >&2; exit 3");
  const Descriptor ours(open("/dev/null", O_RDONLY));  // as from a careless parent
  // ls has 0, 1, 2, the hand-over (3) and the folder that it lists.
  EXPECT_STREQ(Failure().what(), "5");
}

}  // namespace
}  // namespace palpate
