#include "common/arguments/arguments.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <utility>

namespace palpate::arguments {
namespace {

Validator Wrap(const CLI::Validator& validator) {
  return {[validator](const std::string& text) { return validator(text); },
          validator.get_description()};
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
  } catch (const CLI::RequiredError& error) {
    const std::vector<std::string> rest = app.remaining();
    const bool lacks_command =
        app.get_require_subcommand_min() > 0 && app.get_subcommands().empty();
    if (lacks_command && !rest.empty()) throw UsageError("there is no command '" + rest[0] + "'");
    throw UsageError(error.what());
  } catch (const CLI::ParseError& error) {
    throw UsageError(error.what());
  }
}

}  // namespace

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
  app_.exit(CLI::ValidationError(error.what()));
}

}  // namespace palpate::arguments
