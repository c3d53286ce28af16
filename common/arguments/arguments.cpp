#include "common/arguments/arguments.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <numeric>
#include <utility>
#include <vector>

namespace palpate::arguments {
namespace {

Validator Wrap(const CLI::Validator& validator) {
  return {[validator](const std::string& text) { return validator(text); },
          validator.get_description()};
}

// Edits to turn one word into the other: characters to insert, to drop, to replace.
std::size_t Distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

// The command that the command line named last.
const CLI::App& Innermost(const CLI::App& app) {
  const std::vector<CLI::App*> parsed = app.get_subcommands();
  return parsed.empty() ? app : Innermost(*parsed.back());
}

// Returns what is wrong with the first argument that nothing takes; "" if everything is taken.
std::string WhatIsUnknown(const CLI::App& app) {
  const std::vector<std::string> rest = app.remaining(/*recurse=*/true);
  if (rest.empty()) return "";
  const CLI::App& command = Innermost(app);
  const auto option = std::find_if(rest.begin(), rest.end(), [](const std::string& argument) {
    return argument.size() > 1 && argument[0] == '-';
  });
  if (option != rest.end()) {
    std::vector<std::string> names;
    for (const CLI::App* at = &command; at != nullptr; at = at->get_parent()) {
      for (const CLI::Option* known : at->get_options()) {
        for (const std::string& name : known->get_lnames()) names.push_back("--" + name);
      }
    }
    const std::string name = option->substr(0, option->find('='));
    return "there is no option '" + name + "'" + DidYouMean(name, names);
  }
  std::vector<std::string> names;
  for (const CLI::App* known : command.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(known->get_name());
  }
  if (names.empty()) return "'" + rest[0] + "' is one argument too many";
  return "there is no command '" + rest[0] + "'" + DidYouMean(rest[0], names);
}

// Returns false if the program only had to print something.
template <typename Parse>
bool ParseBy(const CLI::App& app, const Parse& parse) {
  try {
    parse();
    return true;
  } catch (const CLI::Success& help) {
    app.exit(help);
    return false;
  } catch (const CLI::ParseError& error) {
    const std::string unknown = WhatIsUnknown(app);
    throw UsageError(unknown.empty() ? error.what() : unknown);
  }
}

}  // namespace

std::string DidYouMean(const std::string& word, const std::vector<std::string>& words) {
  const auto nearest = std::min_element(words.begin(), words.end(), [&](auto& a, auto& b) {
    return Distance(word, a) < Distance(word, b);
  });
  if (nearest == words.end() || 3 * Distance(word, *nearest) > word.size()) return "";
  return ": did you mean '" + *nearest + "'?";
}

Validator ExistingFile() { return Wrap(CLI::ExistingFile); }
Validator NonNegativeNumber() { return Wrap(CLI::NonNegativeNumber); }
Validator PositiveNumber() { return Wrap(CLI::PositiveNumber); }
Validator IsMember(const std::vector<std::string>& values) {
  Validator validator = Wrap(CLI::IsMember(values));
  validator.words = values;
  return validator;
}

template <typename T>
Validator Range(T least, T greatest) {
  return Wrap(CLI::Range(least, greatest));
}
template Validator Range(int, int);
template Validator Range(unsigned, unsigned);
template Validator Range(std::int64_t, std::int64_t);
template Validator Range(double, double);

std::optional<double> FiniteNumber(const std::string& text) {
  double value = 0.0;
  if (!CLI::detail::lexical_cast(text, value) || !std::isfinite(value)) return std::nullopt;
  return value;
}

Validator Finite() {
  return {[](const std::string& text) {
    return FiniteNumber(text) ? std::string() : "'" + text + "' is not a number";
  }};
}

Validator Positive(double greatest) {
  return {[greatest](const std::string& text) {
    const std::optional<double> value = FiniteNumber(text);
    if (value && *value > 0.0 && *value <= greatest) return std::string();
    return "'" + text + "' is not a number above 0" +
           (std::isfinite(greatest) ? fmt::format(", up to {:g}", greatest) : "");
  }};
}

Option* Option::required(bool required) {
  option_->required(required);
  return this;
}

Option* Option::check(const Validator& validator) {
  option_->check(validator.complaint, validator.form);
  if (!validator.words.empty()) words_ = validator.words;
  return this;
}

Option* Option::delimiter(char delimiter) {
  option_->delimiter(delimiter);
  return this;
}

Option* Option::expected(int count) {
  option_->expected(count);
  return this;
}

Option* Option::expected(int least, int greatest) {
  option_->expected(least, greatest);
  return this;
}

Option* Option::take_all() {
  option_->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  return this;
}

Option* Option::excludes(Option* other) {
  option_->excludes(other->option_);
  return this;
}

Option* Option::needs(Option* other) {
  option_->needs(other->option_);
  return this;
}

Option* Option::group(const std::string& name) {
  option_->group(name);
  return this;
}

Option* Option::option_text(const std::string& text) {
  option_->option_text(text);
  return this;
}

Option* Option::type_name(const std::string& name) {
  option_->type_name(name);
  return this;
}

Option* Option::capture_default_str() {
  option_->capture_default_str();
  return this;
}

bool Option::takes_value() const { return option_->get_items_expected_max() > 0; }

Option* Option::suggest(std::vector<std::string> words) {
  words_ = std::move(words);
  return this;
}

std::size_t Option::count() const { return option_->count(); }
std::string Option::get_name() const { return option_->get_name(); }

Command::Command(const std::string& about, const std::string& name)
    : own_(std::make_unique<CLI::App>(about, name)), app_(*own_) {}
Command::Command(CLI::App& app) : app_(app) {}
Command::~Command() = default;

Option* Command::Keep(CLI::Option* option) {
  return options_.emplace_back(new Option(*option)).get();
}

template <typename T>
Option* Command::add_option(const std::string& name, T& value, const std::string& about) {
  return Keep(app_.add_option(name, value, about));
}
#define PALPATE_OPTIONS_OF(...) \
  template Option* Command::add_option(const std::string&, __VA_ARGS__&, const std::string&)
PALPATE_OPTIONS_OF(int);
PALPATE_OPTIONS_OF(unsigned);
PALPATE_OPTIONS_OF(std::int64_t);
PALPATE_OPTIONS_OF(std::uint64_t);
PALPATE_OPTIONS_OF(double);
PALPATE_OPTIONS_OF(std::string);
PALPATE_OPTIONS_OF(std::filesystem::path);
PALPATE_OPTIONS_OF(std::optional<std::int64_t>);
PALPATE_OPTIONS_OF(std::optional<std::uint32_t>);
PALPATE_OPTIONS_OF(std::optional<std::uint64_t>);
PALPATE_OPTIONS_OF(std::optional<double>);
PALPATE_OPTIONS_OF(std::optional<int>);
PALPATE_OPTIONS_OF(std::optional<std::string>);
PALPATE_OPTIONS_OF(std::vector<int>);
PALPATE_OPTIONS_OF(std::vector<std::int64_t>);
PALPATE_OPTIONS_OF(std::vector<std::uint32_t>);
PALPATE_OPTIONS_OF(std::vector<double>);
PALPATE_OPTIONS_OF(std::vector<std::string>);
#undef PALPATE_OPTIONS_OF

Option* Command::add_flag(const std::string& name, bool& given, const std::string& about) {
  return Keep(app_.add_flag(name, given, about));
}

void Command::set_version_flag(const std::string& name, const std::string& version) {
  app_.set_version_flag(name, version);
}

Option* Command::get_option(const std::string& name) const {
  const auto named = [&name](const auto& option) { return option->option_->check_name(name); };
  const auto at = std::find_if(options_.begin(), options_.end(), named);
  if (at == options_.end()) throw std::logic_error("there is no option " + name);
  return at->get();
}

Command* Command::add_subcommand(const std::string& name, const std::string& about) {
  return commands_.emplace_back(new Command(*app_.add_subcommand(name, about))).get();
}

void Command::require_subcommand(int count) { app_.require_subcommand(count); }
void Command::fallthrough() { app_.fallthrough(); }
void Command::description(const std::string& text) { app_.description(text); }
void Command::footer(const std::string& text) { app_.footer(text); }
void Command::callback(std::function<void()> function) { app_.callback(std::move(function)); }
bool Command::parsed() const { return app_.parsed(); }

bool Command::parse(int argc, const char* const* argv) {
  return ParseBy(app_, [&] { app_.parse(argc, argv); });
}

bool Command::parse(std::vector<std::string> arguments) {
  std::reverse(arguments.begin(), arguments.end());  // CLI11 expects the last argument first
  return ParseBy(app_, [&] { app_.parse(std::move(arguments)); });
}

std::string Command::name() const { return app_.get_name(); }

void Command::explain(const UsageError& error) const {
  const std::string name = std::filesystem::path(app_.get_name()).filename();
  fmt::print(stderr, "{}: {}; see --help\n", name, error.what());
}

namespace {

// The `case` clauses of the script. The path of a command is such as " edit sphere"; that of the
// program is "".
struct Clauses {
  std::string commands;  // which words lead from one command to another
  std::string words;  // words that may follow a command: its commands, and words of its arguments
  std::string options;
  std::string values;  // words that an option accepts; empty: file names
};

std::string Joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

void Append(const Command& command, const std::string& path, const std::string& common,
            Clauses& clauses) {
  std::vector<std::string> words, options;
  for (const auto& option : command.options()) {
    const std::string name = option->get_name();
    const std::vector<std::string>& values = option->suggested();
    if (!name.starts_with('-')) {
      words.insert(words.end(), values.begin(), values.end());
      continue;
    }
    options.push_back(name);
    if (option->takes_value()) {
      clauses.values += "    *\" " + name + "\") words=\"" + Joined(values) + "\" options= ;;\n";
    }
  }
  for (const auto& child : command.commands()) {
    words.push_back(child->name());
    clauses.commands += "      \"" + path + " " + child->name() + "\") path=\"$path $word\" ;;\n";
  }
  clauses.words += "    \"" + path + "\") words=\"" + Joined(words) + "\" options=\"" +
                   Joined(options) + " " + common + "\" ;;\n";
  for (const auto& child : command.commands()) {
    Append(*child, path + " " + child->name(), common, clauses);
  }
}

// The options of the program, which every command accepts, too.
std::string CommonOptions(const Command& program) {
  std::vector<std::string> names;
  for (const auto& option : program.options()) {
    if (option->get_name().starts_with('-')) names.push_back(option->get_name());
  }
  names.emplace_back("--help");
  return Joined(names);
}

}  // namespace

std::string CompletionScript(const Command& program) {
  Clauses clauses;
  Append(program, "", CommonOptions(program), clauses);
  const std::string name = program.name();
  const std::string function = "_" + name + "_words";
  return "# Completion of " + name + " for bash and zsh: source <(" + name + R"( completion)
if [ -n "${ZSH_VERSION-}" ]; then
  type compdef >/dev/null 2>&1 || { autoload -Uz compinit && compinit; }
  autoload -U +X bashcompinit && bashcompinit
fi
)" + function +
         R"(() {
  local current="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}"
  local path="" words="" options="" word i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    word="${COMP_WORDS[i]}"
    case "$path $word" in
)" + clauses.commands +
         R"(    esac
  done
  case "$path" in
)" + clauses.words +
         R"(  esac
  case "$path $before" in
)" + clauses.values +
         R"(  esac
  case "$current" in
    -*) words="$options" ;;
  esac
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  if [ -z "$words" ]; then
    local IFS=$'\n'
    COMPREPLY=($(compgen -f -- "$current"))
  fi
}
complete -o filenames -F )" +
         function + " " + name + "\n";
}

}  // namespace palpate::arguments
