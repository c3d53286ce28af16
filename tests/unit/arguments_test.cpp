// Command lines: what we add to CLI11.
#include "common/arguments/arguments.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace palpate::arguments {
namespace {

TEST(Arguments, NumbersAreReadWholeAndWithinTheirRange) {
  for (const char* text : {"", "x", "1x", "1 2", "nan", "inf", "1e999"}) {
    EXPECT_NE(Finite().complaint(text), "") << text;
    EXPECT_NE(Positive().complaint(text), "") << text;
  }
  EXPECT_EQ(Finite().complaint("-1e300"), "");
  EXPECT_EQ(Positive().complaint("1e300"), "");
  EXPECT_NE(Positive().complaint("0"), "");
  EXPECT_EQ(Positive(100.0).complaint("100"), "");
  EXPECT_NE(Positive(100.0).complaint("101"), "");
}

TEST(Arguments, WhatIsNearlyRightIsNamed) {
  EXPECT_NE(DidYouMean("stifness", {"isovalue", "stiffness"}).find("'stiffness'"),
            std::string::npos);
  EXPECT_EQ(DidYouMean("colour", {"isovalue", "stiffness"}), "");
  EXPECT_EQ(DidYouMean("x", {}), "");
  const auto complaint = [](std::vector<std::string> arguments) -> std::string {
    Command program("about", "program");
    std::string text;
    program.add_option("--save-folder", text, "where");
    program.fallthrough();
    Command* edit = program.add_subcommand("edit", "changes");
    edit->require_subcommand(1);
    edit->fallthrough();
    Command* sphere = edit->add_subcommand("sphere", "a ball");
    sphere->add_option("radius", text, "mm")->required();
    sphere->add_option("--falloff", text, "mm");
    try {
      program.parse(std::move(arguments));
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  const auto names = [&](const std::vector<std::string>& arguments, const char* name) {
    EXPECT_NE(complaint(arguments).find(name), std::string::npos) << complaint(arguments);
  };
  names({"edt"}, "'edit'");
  names({"edit", "spere"}, "'sphere'");
  names({"edit", "sphere", "--fallof", "1", "3"}, "'--falloff'");
  names({"edit", "sphere", "--falof"}, "'--falloff'");  // rather than that the radius is missing
  names({"--save-foldr", "/tmp", "edit", "sphere", "3"}, "'--save-folder'");
  names({"edit", "sphere", "3", "4"}, "'4'");
}

// What bash would offer for the last word.
std::string Completed(const Command& program, const std::string& words) {
  const std::string script =
      CompletionScript(program) + "COMP_WORDS=(" + words +
      ")\nCOMP_CWORD=$((${#COMP_WORDS[@]} - 1))\n_program_words\necho \"${COMPREPLY[@]}\"\n";
  return test::Process({"/bin/bash", "-c", script}, std::chrono::seconds(120)).Wait().output;
}

TEST(Arguments, ShellsCompleteCommandsOptionsAndWords) {
  Command program("about", "program");
  std::string text;
  bool flag = false;
  program.add_option("--socket", text, "where");
  Command* edit = program.add_subcommand("edit", "changes");
  Command* sphere = edit->add_subcommand("sphere", "a ball");
  sphere->add_option("--operation", text, "what")->check(IsMember({"add", "subtract"}));
  sphere->add_flag("--json", flag, "as JSON");
  Command* set = program.add_subcommand("set", "sets");
  set->add_option("key", text, "which")->suggest({"stiffness", "damping"});
  EXPECT_EQ(Completed(program, "program ''"), "edit set\n");
  EXPECT_EQ(Completed(program, "program -"), "--socket --socket --help\n");
  EXPECT_EQ(Completed(program, "program e"), "edit\n");
  EXPECT_EQ(Completed(program, "program edit s"), "sphere\n");
  EXPECT_EQ(Completed(program, "program --socket /a edit sphere --o"), "--operation\n");
  EXPECT_EQ(Completed(program, "program edit sphere --operation ''"), "add subtract\n");
  EXPECT_EQ(Completed(program, "program edit sphere --json --so"), "--socket\n");
  EXPECT_EQ(Completed(program, "program set st"), "stiffness\n");
  // Names of files, also those with blanks.
  const test::TemporaryFolder folder;
  const std::string file = folder.path() / "my scan.nrrd";
  std::ofstream(file) << "NRRD";
  EXPECT_EQ(Completed(program, "program --socket " + folder.path().string() + "/m"), file + "\n");
}

}  // namespace
}  // namespace palpate::arguments
