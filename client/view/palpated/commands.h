// Sends the user's commands to palpated on a thread of its own, so that no frame waits for the
// network.
//
// Settings: the newest value wins. Values that were overtaken before sending are never sent. All
// other commands run in order, one after the other, and after the settings that were set before
// them. A Task is one that may take minutes.
//
// Threads: any. Errors: none are thrown; the last error is kept as a line for people.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

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

// A call of palpated that may take minutes: one at a time, on a thread of its own.
//
// Threads: that of the frames. Errors: as Commands.
template <class Result>
class Task {
 public:
  // Runs on the call's thread. `progress` returns false once the call is cancelled.
  using Work = std::function<Result(client::Client&, const client::ProgressFunction& progress)>;

  // `client` must outlive it. The destructor waits for the call: see Commands.
  explicit Task(client::Client& client) : commands_(client) {}

  // Does nothing if a call runs. `name`: as in Commands::Do.
  void Start(std::string name, Work work) {
    if (commands_.busy()) return;
    progress_ = {};
    result_.reset();
    is_cancelled_ = false;
    commands_.Do(std::move(name), [this, work = std::move(work)](client::Client& client) {
      Result result = work(client, [this](const client::Progress& progress) {
        const std::lock_guard lock(mutex_);
        progress_ = progress;
        return !is_cancelled_;
      });
      const std::lock_guard lock(mutex_);
      result_ = std::move(result);
    });
  }
  void Cancel() { is_cancelled_ = true; }
  // None: no call runs.
  std::optional<client::Progress> progress() const {
    if (!commands_.busy()) return std::nullopt;
    const std::lock_guard lock(mutex_);
    return progress_;
  }
  // Returns each result once, when its call has ended.
  std::optional<Result> Take() {
    if (commands_.busy()) return std::nullopt;
    return std::exchange(result_, std::nullopt);
  }
  std::string problem() const { return commands_.problem(); }

 private:
  std::atomic<bool> is_cancelled_{false};
  mutable std::mutex mutex_;  // guards the next two while a call runs
  client::Progress progress_;
  std::optional<Result> result_;
  Commands commands_;  // last: its thread uses the others
};

}  // namespace palpate::view
