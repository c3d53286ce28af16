// Calls of palpated that wait for an answer, on a thread of their own: changes of settings, and
// once a second what palpated does not stream.
//
// Threads: call all methods from any; results and `done` come on the thread. Ownership: borrows the
// client.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/sdk/client.h"

namespace palpate::web {

class CallsThread {
 public:
  using Done = std::function<void(const std::string& error)>;  // "": done
  struct Results {
    // None: there is no series, or no answer.
    std::function<void(const std::optional<client::SeriesState>&)> series;
    std::function<void(const std::optional<client::RecordingState>&)> recording;
    std::function<void(const client::VolumeInfo&)> volume;
  };

  CallsThread(client::Client& client, Results results);
  // Waits for the call that runs: end it by Client::EndCalls.
  ~CallsThread();
  CallsThread(const CallsThread&) = delete;
  CallsThread& operator=(const CallsThread&) = delete;

  // Asks for the volume of this load until it is the one that palpated has.
  void WantVolume(std::uint64_t loaded_revision);
  // While another change is under way, the newest change of a key replaces one that waits. The
  // replaced one is done when the newest one is.
  void Set(const std::string& key, const client::SettingsUpdate& update, Done done);

 private:
  struct Change {
    std::string key;
    client::SettingsUpdate update;
    std::vector<Done> done;
  };
  void Run();
  void Make(const Change& change);
  void AskVolume(std::uint64_t wanted);
  void Poll();

  client::Client& client_;
  const Results results_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  std::vector<Change> changes_;  // that wait, oldest first
  std::optional<std::uint64_t> wanted_volume_;
  bool is_hurried_ = false;  // the wanted volume is another one
  std::thread thread_;
};

}  // namespace palpate::web
