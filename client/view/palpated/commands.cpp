#include "client/view/palpated/commands.h"

#include <exception>
#include <optional>
#include <utility>
#include <variant>

#include "common/error/error.h"

namespace palpate::view {
namespace {

// Copies the value of one setting from another update, if it has one.
struct MergeOne {
  const client::SettingsUpdate& newer;
  client::SettingsUpdate& waiting;

  void operator()(const client::ChoiceSetting& choice) const {
    if (const std::optional<std::size_t> place = choice.updated(newer)) {
      choice.update(waiting, *place);
    }
  }
  // For a number or a flag.
  void operator()(const auto& setting) const {
    if (newer.*setting.update) waiting.*setting.update = newer.*setting.update;
  }
};

}  // namespace

void Merge(const client::SettingsUpdate& newer, client::SettingsUpdate& waiting) {
  // At most one of the two may be sent.
  if (newer.isovalue || newer.normalized_isovalue) {
    waiting.isovalue = newer.isovalue;
    waiting.normalized_isovalue = newer.normalized_isovalue;
  }
  for (const client::Setting& setting : client::kHapticSettings) {
    std::visit(MergeOne{newer, waiting}, setting.kind);
  }
  if (newer.layers) waiting.layers = newer.layers;
  if (newer.tool) waiting.tool = newer.tool;
  if (newer.expected_revision) waiting.expected_revision = newer.expected_revision;
}

Commands::Commands(client::Client& client)
    : client_(client), thread_([this](const std::stop_token& stop) { Run(stop); }) {}

void Commands::Set(const client::SettingsUpdate& update) {
  const std::lock_guard lock(mutex_);
  if (!settings_) settings_.emplace();
  Merge(update, *settings_);
  changed_.notify_all();
}

void Commands::Do(std::string name, std::function<void(client::Client&)> command) {
  const std::lock_guard lock(mutex_);
  waiting_.push_back({std::move(name), std::move(command), settings_.has_value()});
  changed_.notify_all();
}

bool Commands::busy() const {
  const std::lock_guard lock(mutex_);
  return working_ || settings_ || !waiting_.empty();
}

std::string Commands::problem() const {
  const std::lock_guard lock(mutex_);
  return std::chrono::steady_clock::now() < problem_until_ ? problem_ : std::string();
}

void Commands::Run(const std::stop_token& stop) {
  while (const std::optional<Command> command = Next(stop)) {
    try {
      command->run(client_);
      Report({});
    } catch (const std::exception& error) {
      Report(command->name + ": " + error.what());
    }
  }
}

// Waits for the next command; returns none at the end. If settings wait, too, they take turns with
// other commands, so that a moving slider does not block them.
std::optional<Commands::Command> Commands::Next(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  working_ = false;
  changed_.wait(lock, stop, [this] { return settings_ || !waiting_.empty(); });
  if (stop.stop_requested()) return std::nullopt;
  working_ = true;
  const bool is_turn_of_others =
      settings_were_last_ && !waiting_.empty() && !waiting_.front().after_settings;
  settings_were_last_ = settings_ && !is_turn_of_others;
  if (settings_were_last_) {
    for (Command& command : waiting_) command.after_settings = false;
    const client::SettingsUpdate update = *std::exchange(settings_, std::nullopt);
    return Command{"settings", [update](client::Client& client) {
                     const std::string not_kept = client.Set(update).not_kept;
                     if (not_kept.empty()) return;
                     throw Error(ErrorKind::kUnavailable,
                                 "set, but not kept for palpated's next start: " + not_kept);
                   }};
  }
  Command command = std::move(waiting_.front());
  waiting_.pop_front();
  return command;
}

void Commands::Report(const std::string& problem) {
  const std::lock_guard lock(mutex_);
  problem_ = problem;
  problem_until_ = std::chrono::steady_clock::now() + kProblemTime;
}

}  // namespace palpate::view
