// Command lines: values of all types, what is refused and in which words, and help.
#include "common/arguments/arguments.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "common/arguments/completion.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace palpate::arguments {
namespace {

using Words = std::vector<std::string>;

// What is wrong with the words; empty: nothing.
std::string Complaint(Command& program, const Words& words) {
  try {
    EXPECT_TRUE(program.parse(words));
    return "";
  } catch (const UsageError& error) {
    return error.what();
  }
}

TEST(Arguments, ValuesOfAllTypesAreStored) {
  Command program("about", "program");
  int whole = 0;
  unsigned natural = 0;
  std::int64_t wide = 0;
  std::uint64_t bytes = 0;
  double real = 0.0;
  std::string text;
  std::filesystem::path path;
  std::optional<std::int64_t> some_wide;
  std::optional<std::uint32_t> some_natural;
  std::optional<std::uint64_t> some_bytes;
  std::optional<double> some_real, absent;
  std::optional<std::string> some_text;
  std::vector<std::int64_t> wides;
  std::vector<std::uint32_t> naturals;
  std::vector<double> reals;
  Words texts;
  program.add_option("--whole", whole, "");
  program.add_option("--natural", natural, "");
  program.add_option("--wide", wide, "");
  program.add_option("--bytes", bytes, "");
  program.add_option("--real", real, "");
  program.add_option("--text", text, "");
  program.add_option("--path", path, "");
  program.add_option("--some-wide", some_wide, "");
  program.add_option("--some-natural", some_natural, "");
  program.add_option("--some-bytes", some_bytes, "");
  program.add_option("--some-real", some_real, "");
  program.add_option("--absent", absent, "");
  program.add_option("--some-text", some_text, "");
  program.add_option("--wides", wides, "")->delimiter(',')->expected(3);
  program.add_option("--naturals", naturals, "")->delimiter(',')->expected(1, 3);
  program.add_option("--reals", reals, "");
  program.add_option("--texts", texts, "")->expected(1)->take_all();
  EXPECT_EQ(Complaint(program, {"--whole",
                                "-7",
                                "--natural",
                                "7",
                                "--wide",
                                "-8000000000",
                                "--bytes",
                                "18446744073709551615",
                                "--real",
                                "-0.25",
                                "--text",
                                "a b",
                                "--path",
                                "/a/b c",
                                "--some-wide",
                                "-8000000001",
                                "--some-natural",
                                "4294967295",
                                "--some-bytes",
                                "9",
                                "--some-real",
                                "1e3",
                                "--some-text",
                                "",
                                "--wides",
                                "1,-2,3",
                                "--naturals",
                                "4,5",
                                "--reals",
                                "0.5",
                                "1.5",
                                "--texts",
                                "x",
                                "--texts",
                                "y"}),
            "");
  EXPECT_EQ(whole, -7);
  EXPECT_EQ(natural, 7u);
  EXPECT_EQ(wide, -8'000'000'000);
  EXPECT_EQ(bytes, UINT64_MAX);
  EXPECT_EQ(real, -0.25);
  EXPECT_EQ(text, "a b");
  EXPECT_EQ(path, "/a/b c");
  EXPECT_EQ(some_wide, -8'000'000'001);
  EXPECT_EQ(some_natural, UINT32_MAX);
  EXPECT_EQ(some_bytes, 9u);
  EXPECT_EQ(some_real, 1000.0);
  EXPECT_FALSE(absent);
  EXPECT_EQ(some_text, "");
  EXPECT_EQ(wides, (std::vector<std::int64_t>{1, -2, 3}));
  EXPECT_EQ(naturals, (std::vector<std::uint32_t>{4, 5}));
  EXPECT_EQ(reals, (std::vector<double>{0.5, 1.5}));
  EXPECT_EQ(texts, (Words{"x", "y"}));
}

// Of one option "--value" with this validator, what is wrong with a text.
std::string ComplaintOf(const Validator& validator, const std::string& text) {
  Command program("about", "program");
  std::string value;
  program.add_option("--value", value, "")->check(validator);
  return Complaint(program, {"--value=" + text});
}

TEST(Arguments, ValidatorsRefuseWhatIsOutside) {
  EXPECT_EQ(ComplaintOf(Range(1, 3), "1"), "");
  EXPECT_EQ(ComplaintOf(Range(1, 3), "3"), "");
  EXPECT_EQ(ComplaintOf(Range(1, 3), "4"), "--value: Value 4 not in range 1 to 3");
  EXPECT_NE(ComplaintOf(Range(1, 3), "1.5"), "");
  EXPECT_EQ(ComplaintOf(Range(0.5, 3.0), "1.5"), "");
  EXPECT_NE(ComplaintOf(Range(0.5, 3.0), "0.4"), "");
  EXPECT_NE(ComplaintOf(Range(1u, 3u), "-1"), "");
  EXPECT_EQ(ComplaintOf(IsMember({"on", "off"}), "off"), "");
  EXPECT_EQ(ComplaintOf(IsMember({"on", "off"}), "of"), "--value: of not in {on,off}");
  EXPECT_EQ(ComplaintOf(ExistingFile(), "/proc/self/exe"), "");
  EXPECT_NE(ComplaintOf(ExistingFile(), "/proc/self/no such file"), "");
  EXPECT_NE(ComplaintOf(ExistingFile(), "/proc"), "");
  EXPECT_EQ(ComplaintOf(NonNegativeNumber(), "0"), "");
  EXPECT_NE(ComplaintOf(NonNegativeNumber(), "-1"), "");
  EXPECT_NE(ComplaintOf(PositiveNumber(), "0"), "");
  EXPECT_EQ(ComplaintOf(Finite(), "-1e300"), "");
  EXPECT_EQ(ComplaintOf(Finite(), "inf"), "--value: 'inf' is not a number");
  EXPECT_EQ(ComplaintOf(Positive(), "1e300"), "");
  EXPECT_EQ(ComplaintOf(Positive(), "0"), "--value: '0' is not a number above 0");
  EXPECT_EQ(ComplaintOf(Positive(100.0), "100"), "");
  EXPECT_EQ(ComplaintOf(Positive(100.0), "101"),
            "--value: '101' is not a number above 0, up to 100");
  EXPECT_NE(ComplaintOf(Positive(), "nan"), "");
}

TEST(Arguments, NumbersAreReadWhole) {
  EXPECT_EQ(FiniteNumber("-2.5e1"), -25.0);
  for (const char* text : {"", "x", "1x", "1 2", "nan", "inf", "1e999"}) {
    EXPECT_FALSE(FiniteNumber(text)) << text;
  }
}

TEST(Arguments, OptionsThatNeedAndExcludeOthers) {
  const auto complaint = [](const Words& words) {
    Command program("about", "program");
    bool flag = false;
    double a = 0.0, b = 0.0;
    Option* first = program.add_option("-a,--first", a, "")->required();
    program.add_option("--second", b, "")->needs(program.add_flag("--flag", flag, ""));
    program.add_option("--third", b, "")->excludes(first);
    return Complaint(program, words);
  };
  EXPECT_EQ(complaint({"--first", "1"}), "");
  EXPECT_EQ(complaint({}), "--first is required");
  EXPECT_EQ(complaint({"-a", "1", "--second", "2"}), "--second requires --flag");
  EXPECT_EQ(complaint({"-a", "1", "--second", "2", "--flag"}), "");
  EXPECT_EQ(complaint({"-a", "1", "--third", "2"}), "--first excludes --third");
  EXPECT_NE(complaint({"-a", "1", "--fourth"}), "");
}

TEST(Arguments, AnOptionIsFoundByItsNameAndCounted) {
  Command program("about", "program");
  double value = 0.0;
  Option* option = program.add_option("--value", value, "")->required();
  EXPECT_EQ(program.get_option("--value"), option);
  EXPECT_EQ(option->get_name(), "--value");
  EXPECT_THROW(program.get_option("--other"), std::logic_error);
  program.get_option("--value")->required(false);
  EXPECT_EQ(Complaint(program, {}), "");
  EXPECT_EQ(option->count(), 0u);
  EXPECT_EQ(Complaint(program, {"--value", "1"}), "");
  EXPECT_EQ(option->count(), 1u);
}

TEST(Arguments, CommandsRunTheirCallbacksAndLeaveOptionsToTheProgram) {
  Command program("about", "program");
  program.require_subcommand(1);
  program.fallthrough();
  bool json = false;
  int calls = 0;
  program.add_flag("--json", json, "");
  Command* run = program.add_subcommand("run", "");
  Command* stop = program.add_subcommand("stop", "");
  run->callback([&calls] { ++calls; });
  stop->callback([] { throw UsageError("there is nothing to stop"); });
  EXPECT_EQ(Complaint(program, {}), "A subcommand is required");
  EXPECT_EQ(Complaint(program, {"bogus"}), "there is no command 'bogus'");
  EXPECT_EQ(Complaint(program, {"run", "--json"}), "");
  EXPECT_TRUE(json);
  EXPECT_EQ(calls, 1);
  EXPECT_TRUE(run->parsed());
  EXPECT_FALSE(stop->parsed());
  EXPECT_EQ(Complaint(program, {"stop"}), "there is nothing to stop");
}

Command& Described(Command& program, double& value) {
  program.set_version_flag("--version", "program 1.2");
  program.footer("The end.");
  program.add_option("--value", value, "A value")->check(Range(0.0, 3.0))->capture_default_str();
  program.add_option("--size", value, "A size")->option_text("MM")->group("Sizes");
  return program;
}

TEST(Arguments, HelpAndVersionArePrintedAndLeaveNothingToDo) {
  double value = 0.5;
  Command program("What it does.", "program");
  Described(program, value);
  testing::internal::CaptureStdout();
  EXPECT_FALSE(program.parse({"--help"}));
  EXPECT_EQ(testing::internal::GetCapturedStdout(),
            "What it does.\n"
            "Usage: program [OPTIONS]\n"
            "\n"
            "Options:\n"
            "  -h,--help                   Print this help message and exit\n"
            "  --version                   Display program version information and exit\n"
            "  --value FLOAT:FLOAT in [0 - 3]=0.5\n"
            "                              A value\n"
            "\n"
            "\n"
            "Sizes:\n"
            "  --size MM                   A size\n"
            "\n"
            "The end.\n");
  testing::internal::CaptureStdout();
  EXPECT_FALSE(program.parse({"--version"}));
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "program 1.2\n");
}

TEST(Arguments, AProgramWithoutANameIsCalledAsArgvSays) {
  Command program("about");
  const char* const words[] = {"bin/program", "--help"};
  testing::internal::CaptureStdout();
  EXPECT_FALSE(program.parse(2, words));
  EXPECT_NE(testing::internal::GetCapturedStdout().find("Usage: bin/program [OPTIONS]\n"),
            std::string::npos);
}

TEST(Arguments, ErrorsAreExplained) {
  Command program("about", "program");
  testing::internal::CaptureStderr();
  program.explain(UsageError("--value is required"));
  EXPECT_EQ(testing::internal::GetCapturedStderr(),
            "--value is required\nRun with --help for more information.\n");
}

// What bash would offer for the last word.
std::string Completed(const Command& program, const std::string& words) {
  const std::string script =
      CompletionScript(program) + "COMP_WORDS=(" + words +
      ")\nCOMP_CWORD=$((${#COMP_WORDS[@]} - 1))\n_program_words\necho \"${COMPREPLY[@]}\"\n";
  return test::Process({"/bin/bash", "-c", script}).Wait().output;
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
  EXPECT_EQ(Completed(program, "program --socket /etc/hostnam"), "/etc/hostname\n");
  const test::TemporaryFolder folder;
  const std::string file = folder.path() / "my scan.nrrd";
  std::ofstream(file) << "NRRD";
  EXPECT_EQ(Completed(program, "program --socket " + folder.path().string() + "/m"), file + "\n");
}

}  // namespace
}  // namespace palpate::arguments
