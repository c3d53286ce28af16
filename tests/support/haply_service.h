// Runs the emulator of Haply's Inverse service. haply_service.py lists what can be set, the faults,
// and its limits.
//
// Threads: any; each call waits for the emulator's answer. The test fails, with the text, if the
// emulator refuses a command, does not answer, or does not end in order.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>

namespace palpate::test {

class HaplyService {
 public:
  // Returns when the service listens. Throws if it does not start.
  HaplyService();
  ~HaplyService();
  HaplyService(const HaplyService&) = delete;
  HaplyService& operator=(const HaplyService&) = delete;

  int port() const { return port_; }
  int events_port() const { return events_port_; }

  void Set(const nlohmann::json& changes);
  // `messages`: how many of the last messages it contains, at most 2000. Empty if there is no
  // answer.
  nlohmann::json Report(int messages = 0);
  void SendEvent(const nlohmann::json& event);
  // Ends all connections. Nobody listens on the ports for this time; the call does not wait for it.
  void Restart(std::chrono::milliseconds absence);
  // Ends all connections, without a close frame.
  void Drop();

 private:
  nlohmann::json Ask(const char* name, const nlohmann::json& value);
  std::string ReadLine();
  void End();

  std::mutex mutex_;  // one command at a time
  pid_t pid_ = -1;
  int commands_ = -1;
  int answers_ = -1;
  int port_ = 0;
  int events_port_ = 0;
  std::string unread_;
};

}  // namespace palpate::test
