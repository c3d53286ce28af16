// What the user asks of palpated, done on a thread of its own, so that no frame waits
// for the network.
//
// Settings: the newest wins; those that were overtaken before they were sent never
// travel. All else is done in order, one after the other.
//
// Threads: any. Errors: none are thrown; the last one is kept as a line for people.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/sdk/client.h"

namespace palpate::view {

// What `newer` says replaces it in `waiting`, key by key.
void Merge(const client::SettingsUpdate& newer, client::SettingsUpdate& waiting);

class Commands {
 public:
  // `client` outlives it.
  explicit Commands(client::Client& client);
  // What is not begun is dropped; what is under way is waited for, which after
  // Client::EndCalls is at once.
  ~Commands();
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;

  // Merged with what waits, key by key.
  void Set(const client::SettingsUpdate& update);
  // `name`: "undo", for the line of an error.
  void Do(std::string name, std::function<void(client::Client&)> command);

  // Something waits or is under way.
  bool busy() const;
  // "undo: there is nothing to undo", for kProblemTime; empty: the last command went
  // well, or that was longer ago. Settings are a command.
  static constexpr std::chrono::seconds kProblemTime{8};
  std::string problem() const;

 private:
  struct Command {
    std::string name;
    std::function<void(client::Client&)> run;
  };

  void Run();
  std::optional<Command> Next();
  void Report(const std::string& problem);

  client::Client& client_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<client::SettingsUpdate> settings_;
  bool settings_were_last_ = false;
  std::deque<Command> waiting_;
  bool working_ = false;
  bool stopping_ = false;
  std::string problem_;
  std::chrono::steady_clock::time_point problem_until_{};
  std::thread thread_;
};

}  // namespace palpate::view
