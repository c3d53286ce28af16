// Programs beside the viewer: the file dialog, and a palpated of the user's own.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <thread>

#include "client/view/palpated/child_program.h"
#include "client/view/palpated/file_dialog.h"
#include "client/view/palpated/local_daemon.h"
#include "common/error/error.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate::view {
namespace {

using namespace std::chrono_literals;
using test::Eventually;

class ViewDesktop : public ::testing::Test {
 protected:
  // A program of this name that runs these lines of shell.
  std::filesystem::path Script(const std::string& name, const std::string& lines) {
    const std::filesystem::path path = folder_.path() / name;
    std::ofstream(path) << "#!/bin/sh\n" << lines << "\n";
    chmod(path.c_str(), 0700);
    return path;
  }
  std::string path() const { return "/nowhere::" + folder_.path().string(); }

  test::TemporaryFolder folder_;
};

int EndOf(ChildProgram& program) {
  EXPECT_TRUE(Eventually([&] { return program.Poll().has_value(); }));
  return program.Poll().value_or(-1000);
}

TEST_F(ViewDesktop, FindsTheDialogThatIsInstalled) {
  EXPECT_EQ(FindDialogProgram(path(), ""), "");
  // Not a program.
  std::ofstream(folder_.path() / "zenity") << "text";
  Script("yad", "");
  EXPECT_EQ(FindDialogProgram(path(), "").filename(), "yad");
  Script("kdialog", "");
  EXPECT_EQ(FindDialogProgram(path(), "").filename(), "kdialog");
  Script("zenity", "");
  EXPECT_EQ(FindDialogProgram(path(), "GNOME").filename(), "zenity");
  EXPECT_EQ(FindDialogProgram(path(), "KDE").filename(), "kdialog");
}

// A start without a slash at its end would be a file's name.
TEST_F(ViewDesktop, TheDialogBeginsInTheFolder) {
  for (const char* program : {"/usr/bin/zenity", "/usr/bin/kdialog", "/usr/bin/yad"}) {
    for (const DialogKind kind : {DialogKind::kOpenFile, DialogKind::kOpenFolder}) {
      const auto command = DialogCommand(program, kind, "/data/two words");
      EXPECT_EQ(command.front(), program);
      EXPECT_TRUE(command.back().ends_with("/data/two words/")) << command.back();
    }
    const auto save = DialogCommand(program, DialogKind::kSave, "/data/a.nrrd");
    EXPECT_TRUE(save.back().ends_with("/data/a.nrrd"));
    EXPECT_NE(DialogCommand(program, DialogKind::kOpenFile, "/d"),
              DialogCommand(program, DialogKind::kOpenFolder, "/d"));
  }
}

TEST_F(ViewDesktop, AnAnswerIsAPath) {
  EXPECT_EQ(DialogAnswer(0, "/data/a b.nrrd\n"), "/data/a b.nrrd");
  EXPECT_EQ(DialogAnswer(0, "/data/odd\n\n"), "/data/odd\n");
  EXPECT_FALSE(DialogAnswer(1, "/data/a.nrrd\n"));  // cancelled
  EXPECT_FALSE(DialogAnswer(-15, "/data/a.nrrd\n"));
  EXPECT_FALSE(DialogAnswer(0, ""));
  EXPECT_FALSE(DialogAnswer(0, "a warning\n"));
}

TEST_F(ViewDesktop, AChildPrintsAndEnds) {
  ChildProgram good({Script("good", "echo /a/b; echo noise >&2; exit 0")});
  EXPECT_EQ(EndOf(good), 0);
  EXPECT_EQ(good.output(), "/a/b\n");
  ChildProgram bad({Script("bad", "exit 7")});
  EXPECT_EQ(EndOf(bad), 7);
  ChildProgram chatty({Script("chatty", "yes | head -c 1000000")});
  EXPECT_EQ(EndOf(chatty), 0);
  EXPECT_EQ(chatty.output().size(), 64u * 1024);
  EXPECT_THROW(ChildProgram({"/nowhere/program"}), Error);
}

TEST_F(ViewDesktop, AChildIsEndedWithItsOwnChildren) {
  const std::filesystem::path mark = folder_.path() / "pid";
  pid_t grandchild = 0;
  {
    ChildProgram stubborn(
        {Script("stubborn", "trap '' TERM; sh -c 'trap \"\" TERM; echo $$ >" + mark.string() +
                                ".new; mv " + mark.string() + ".new " + mark.string() +
                                "; while :; do sleep 1; done'; exit 0")});
    ASSERT_TRUE(Eventually([&] { return std::filesystem::exists(mark); }));
    std::ifstream(mark) >> grandchild;
    stubborn.End(50ms);
    EXPECT_EQ(stubborn.Poll(), -SIGKILL);
  }
  EXPECT_TRUE(Eventually([&] {
    std::ifstream stat("/proc/" + std::to_string(grandchild) + "/stat");
    std::string text;
    std::getline(stat, text);
    return text.empty() || text.find(") Z") != std::string::npos;
  }));
}

TEST_F(ViewDesktop, ALogHoldsBothOutputs) {
  const std::filesystem::path log = folder_.path() / "log";
  ChildProgram program({Script("two", "echo one; echo 'palpated: two' >&2; echo")}, log);
  EXPECT_EQ(EndOf(program), 0);
  EXPECT_EQ(LastLineOf(log), "palpated: two");
  std::ofstream(log) << "2026-01-31 12:00:00.123 error no space: left\n";
  EXPECT_EQ(LastLineOf(log), "no space: left");
  EXPECT_EQ(LastLineOf(folder_.path() / "none"), "");
}

TEST_F(ViewDesktop, PalpatedBesideTheViewerComesFirst) {
  std::filesystem::create_directory(folder_.path() / "bin");
  EXPECT_EQ(FindPalpated(folder_.path() / "bin", path()), "");
  const std::filesystem::path in_path = Script("palpated", "");
  EXPECT_EQ(FindPalpated(folder_.path() / "bin", path()), in_path);
  const std::filesystem::path beside = Script("bin/palpated", "");
  EXPECT_EQ(FindPalpated(folder_.path() / "bin", path()), beside);
}

TEST_F(ViewDesktop, APalpatedThatEndsSaysWhy) {
  // Found in PATH: there is none beside the test.
  Script("palpated", "echo \"$@\"; echo 'palpated: the socket is taken' >&2; exit 3");
  setenv("PATH", (folder_.path().string() + ":/usr/bin:/bin").c_str(), 1);
  LocalDaemon daemon;
  daemon.Start((folder_.path() / "socket").string(), folder_.path() / "state", false);
  EXPECT_TRUE(daemon.runs());
  EXPECT_EQ(daemon.problem(), "");
  EXPECT_TRUE(Eventually([&] {
    daemon.Poll();
    return !daemon.runs();
  }));
  EXPECT_NE(daemon.problem().find("the socket is taken"), std::string::npos) << daemon.problem();
  std::string arguments;
  std::ifstream in(daemon.log());
  std::getline(in, arguments);
  EXPECT_NE(arguments.find("--socket " + (folder_.path() / "socket").string()), std::string::npos);
}

TEST_F(ViewDesktop, OnlyEditsOfItsOwnPalpatedAreLostWithIt) {
  Script("palpated", "exec sleep 1000");
  setenv("PATH", (folder_.path().string() + ":/usr/bin:/bin").c_str(), 1);
  const std::string socket = (folder_.path() / "socket").string();
  LocalDaemon daemon;
  daemon.NoteUnsaved("unix:" + socket, 2);
  EXPECT_FALSE(daemon.LosesEdits());
  daemon.Start(socket, folder_.path() / "state", false);
  EXPECT_TRUE(daemon.Serves("unix:" + socket));
  daemon.NoteUnsaved("unix:/elsewhere", 3);
  EXPECT_FALSE(daemon.LosesEdits());
  daemon.NoteUnsaved("unix:" + socket, 2);
  // The window goes on to another one.
  daemon.NoteUnsaved("unix:/elsewhere", 0);
  EXPECT_TRUE(daemon.LosesEdits());
  EXPECT_EQ(daemon.unsaved_edits(), 2u);
  daemon.Keep(true);
  EXPECT_FALSE(daemon.LosesEdits());
  daemon.Keep(false);
}

TEST_F(ViewDesktop, NobodyServesASocketThatIsNotThere) {
  EXPECT_FALSE(IsServed((folder_.path() / "none").string()));
  EXPECT_FALSE(IsServed(std::string(300, 'x')));
}

}  // namespace
}  // namespace palpate::view
