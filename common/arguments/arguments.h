// A program's command line: its commands, options and help.
//
// A thin layer over CLI11, with CLI11's names and behaviour. Including CLI11 costs 15 s per file,
// so only arguments.cpp includes it.
// Values are stored while the command line is parsed, so the variables must live until then.
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

// A wrong command line: one line for the user. Callbacks may throw it.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Returns ": did you mean 'stiffness'?" if one of the words is nearly `word`, otherwise "".
std::string DidYouMean(const std::string& word, const std::vector<std::string>& words);

// The rule for a value on the command line.
struct Validator {
  std::function<std::string(const std::string&)> complaint;  // returns "" for a right value
  std::string form{};                                        // shown in --help
  std::vector<std::string> words{};                          // the accepted words; empty: any text
};

Validator ExistingFile();
Validator NonNegativeNumber();
Validator PositiveNumber();
Validator IsMember(const std::vector<std::string>& values);
// From `least` to `greatest`, both included. T: int, unsigned, std::int64_t, double.
template <typename T>
Validator Range(T least, T greatest);
// A finite number.
Validator Finite();
// A finite number above 0, up to `greatest`.
Validator Positive(double greatest = std::numeric_limits<double>::infinity());

// Returns the number that options read from `text`; none if it is not a finite number.
std::optional<double> FiniteNumber(const std::string& text);

// An option of a command. The command owns it. Functions return the option itself.
class Option {
 public:
  Option* required(bool required = true);
  Option* check(const Validator& validator);
  Option* delimiter(char delimiter);  // between the values of one argument
  Option* expected(int count);
  Option* expected(int least, int greatest);
  Option* take_all();  // if the option is given several times
  Option* excludes(Option* other);
  Option* needs(Option* other);
  // In --help:
  Option* group(const std::string& name);
  Option* option_text(const std::string& text);  // instead of type and default
  Option* type_name(const std::string& name);
  Option* capture_default_str();
  // Used only for the completion of shells.
  Option* suggest(std::vector<std::string> words);

  std::size_t count() const;  // the number of its values on the command line
  std::string get_name() const;
  bool takes_value() const;  // false for a flag
  const std::vector<std::string>& suggested() const { return words_; }

 private:
  friend class Command;
  explicit Option(CLI::Option& option) : option_(&option) {}
  CLI::Option* option_;
  std::vector<std::string> words_;
};

// A program, or one of its commands.
class Command {
 public:
  // Without a name, the program's name is that of argv.
  explicit Command(const std::string& about = "", const std::string& name = "");
  ~Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  // T: see the list in arguments.cpp; another type does not link.
  template <typename T>
  Option* add_option(const std::string& name, T& value, const std::string& about);
  Option* add_flag(const std::string& name, bool& given, const std::string& about);
  void set_version_flag(const std::string& name, const std::string& version);
  // Errors: std::logic_error if there is no option of that name.
  Option* get_option(const std::string& name) const;

  Command* add_subcommand(const std::string& name, const std::string& about);
  void require_subcommand(int count);
  void fallthrough();  // its commands pass unknown options up to it

  void description(const std::string& text);
  void footer(const std::string& text);

  // `function` is called at the end of parse() if the command line named the command.
  void callback(std::function<void()> function);
  bool parsed() const;  // the command line named the command

  // Returns false after --help or --version: the text is printed, and the program is done. Errors:
  // UsageError; exceptions of callbacks.
  bool parse(int argc, const char* const* argv);
  bool parse(std::vector<std::string> arguments);  // without the program's name
  std::string name() const;
  const std::vector<std::unique_ptr<Option>>& options() const { return options_; }
  const std::vector<std::unique_ptr<Command>>& commands() const { return commands_; }
  // Prints "NAME: what is wrong; see --help" on stderr.
  void explain(const UsageError& error) const;

 private:
  explicit Command(CLI::App& app);
  Option* Keep(CLI::Option* option);
  const std::unique_ptr<CLI::App> own_;  // of the program; null for its commands
  CLI::App& app_;
  std::vector<std::unique_ptr<Option>> options_;
  std::vector<std::unique_ptr<Command>> commands_;
};

// The script by which shells complete a program's command line.
//
// For bash, and for zsh with its bashcompinit. Completes commands, options, and the words of a
// value. Completes file names elsewhere.
std::string CompletionScript(const Command& program);

}  // namespace palpate::arguments
