// Files that a user names, which may be anything.
#include "common/files/text_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using testing::Refusal;

TEST(TextFile, IsReadWholeOrRefusedAtOnce) {
  const test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return folder.path() / name; };
  const std::string text("a\0b\n", 4);
  std::ofstream(path("text"), std::ios::binary) << text;
  std::filesystem::create_symlink("text", path("link"));
  EXPECT_EQ(ReadTextFile(path("text"), 4), text);
  EXPECT_EQ(ReadTextFile(path("link"), 1 << 20), text);
  mkfifo(path("pipe").c_str(), 0600);  // nobody writes to it
  struct Row {
    std::filesystem::path path;
    ErrorKind kind;
  };
  for (const Row& row :
       {Row{path("absent"), ErrorKind::kNotFound}, Row{path("text") / "x", ErrorKind::kNotFound},
        Row{folder.path(), ErrorKind::kInvalidArgument},
        Row{path("pipe"), ErrorKind::kInvalidArgument},
        Row{"/dev/zero", ErrorKind::kInvalidArgument},
        Row{path("text"), ErrorKind::kInvalidArgument}}) {
    EXPECT_EQ(Refusal([&] { ReadTextFile(row.path, 3); }), row.kind) << row.path;
  }
}

}  // namespace
}  // namespace palpate
