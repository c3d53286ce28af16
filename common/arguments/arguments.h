// A program's command line: its commands, options and help.
//
// A thin cover of CLI11: names and behaviour are CLI11's. A file that includes CLI11
// takes 15 s to compile, so only arguments.cpp does.
// Values are stored while the command line is parsed: the variables must live until then.
// Threads: main only.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace palpate::arguments {

// The command line is wrong: one line for the user. Callbacks may throw it.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// What a value on the command line must be.
struct Validator {
  std::function<std::string(const std::string&)> complaint;  // empty: nothing is wrong
  std::string form{};                                        // shown in --help
  std::vector<std::string> words{};  // of which it is one; empty: it may be another
};

Validator ExistingFile();
Validator NonNegativeNumber();
Validator PositiveNumber();
Validator IsMember(const std::vector<std::string>& values);
// Both ends included. T: int, unsigned, std::int64_t, double.
template <typename T>
Validator Range(T least, T greatest);
// A number that is finite.
Validator Finite();
// A finite number above 0, up to `greatest`.
Validator Positive(double greatest = std::numeric_limits<double>::infinity());

// The number that `text` is, as options read it; none where it is no finite number.
std::optional<double> FiniteNumber(const std::string& text);

// An option of a command, owned by it. Functions return the option itself.
class Option {
 public:
  Option* required(bool required = true);
  Option* check(const Validator& validator);
  Option* delimiter(char delimiter);  // of the values of one argument
  Option* expected(int count);
  Option* expected(int least, int greatest);
  Option* take_all();  // where it is given several times
  Option* excludes(Option* other);
  Option* needs(Option* other);
  // In --help:
  Option* group(const std::string& name);
  Option* option_text(const std::string& text);  // instead of type and default
  Option* type_name(const std::string& name);
  Option* capture_default_str();
  // For the completion of shells alone.
  Option* suggest(std::vector<std::string> words);

  std::size_t count() const;  // of its values on the command line
  std::string get_name() const;
  bool takes_value() const;  // is no flag
  const std::vector<std::string>& suggested() const { return words_; }

 private:
  friend class Command;
  explicit Option(CLI::Option& option) : option_(&option) {}
  CLI::Option* option_;
  std::vector<std::string> words_;
};

// A program, or a command of one.
class Command {
 public:
  // Without a name the program is called as argv says.
  explicit Command(const std::string& about = "", const std::string& name = "");
  ~Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  // T: see the list in arguments.cpp; another type does not link.
  template <typename T>
  Option* add_option(const std::string& name, T& value, const std::string& about);
  Option* add_flag(const std::string& name, bool& given, const std::string& about);
  void set_version_flag(const std::string& name, const std::string& version);
  // Errors: std::logic_error where there is none of that name.
  Option* get_option(const std::string& name) const;

  Command* add_subcommand(const std::string& name, const std::string& about);
  void require_subcommand(int count);
  void fallthrough();  // commands leave options that they do not know to this one

  void description(const std::string& text);
  void footer(const std::string& text);

  // Called at the end of parse() where the command was named.
  void callback(std::function<void()> function);
  bool parsed() const;  // the command was named

  // False after --help or --version: it is printed, and nothing is left to do.
  // Errors: UsageError; what callbacks throw.
  bool parse(int argc, const char* const* argv);
  bool parse(std::vector<std::string> arguments);  // without the program's name
  std::string name() const;
  const std::vector<std::unique_ptr<Option>>& options() const { return options_; }
  const std::vector<std::unique_ptr<Command>>& commands() const { return commands_; }
  // Says on stderr what is wrong, and how to get help.
  void explain(const UsageError& error) const;

 private:
  explicit Command(CLI::App& app);
  Option* Keep(CLI::Option* option);
  const std::unique_ptr<CLI::App> own_;  // of the program; none for its commands
  CLI::App& app_;
  std::vector<std::unique_ptr<Option>> options_;
  std::vector<std::unique_ptr<Command>> commands_;
};

}  // namespace palpate::arguments
