// Sends the user's commands to palpated on a thread of its own, so that no frame waits for the
// network.
//
// Settings: the newest value wins. Values that were overtaken before sending are never sent. All
// other commands run in order, one after the other, and after the settings that were set before
// them.
//
// Threads: any. Errors: none are thrown; the last error is kept as a line for people.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "client/sdk/client.h"

namespace palpate::view {

// Copies the values of `newer` into `waiting`, key by key.
void Merge(const client::SettingsUpdate& newer, client::SettingsUpdate& waiting);

// The destructor drops waiting commands and waits for the running one. After Client::EndCalls, the
// running one ends at once.
class Commands {
 public:
  // `client` must outlive it.
  explicit Commands(client::Client& client);

  // Merges the update with waiting settings, key by key.
  void Set(const client::SettingsUpdate& update);
  // `name`: for the text of an error, such as "undo".
  void Do(std::string name, std::function<void(client::Client&)> command);

  // True if a command waits or runs.
  bool busy() const;
  // The error of the last command, such as "undo: there is nothing to undo". Empty if the last
  // command succeeded, or failed more than kProblemTime ago. Settings count as a command.
  static constexpr std::chrono::seconds kProblemTime{8};
  std::string problem() const;

 private:
  struct Command {
    std::string name;
    std::function<void(client::Client&)> run;
    bool after_settings = false;  // settings that were set before it wait
  };

  void Run(const std::stop_token& stop);
  std::optional<Command> Next(const std::stop_token& stop);
  void Report(const std::string& problem);

  client::Client& client_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::optional<client::SettingsUpdate> settings_;
  bool settings_were_last_ = false;
  std::deque<Command> waiting_;
  bool working_ = false;
  std::string problem_;
  std::chrono::steady_clock::time_point problem_until_{};
  std::jthread thread_;
};

}  // namespace palpate::view
