// The stream of a room, which keeps the newest message of each kept subject in the server's memory.
//
// Threads: methods on one, which they let wait. Ownership: borrows the link.
// Errors: kDiskFull: the server refuses a message, for lack of memory; kUnavailable: all else.
// After one of them, Ensure() begins anew.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <string_view>

#include "client/web/room/nats_link.h"
#include "client/web/room/subjects.h"
#include "common/error/error.h"

namespace palpate::web {

class KeptStream {
 public:
  // Before the link's Start.
  KeptStream(NatsLink& link, const Subjects& subjects);
  KeptStream(const KeptStream&) = delete;
  KeptStream& operator=(const KeptStream&) = delete;

  // Creates the stream unless it is there. Returns whether it keeps all that was acknowledged, and
  // nothing of others'. Messages count anew.
  bool Ensure();
  // Drops what is kept of the subjects.
  void Purge(const std::string& subjects);
  // Waits while kMostUnderWay messages have no answer. Bytes are copied or sent. Returns the
  // message's number, from 1.
  std::uint64_t Publish(const std::string& subject, std::string_view bytes);
  // Until all that was published is acknowledged. Calls `meanwhile`, which may publish, ten times a
  // second.
  void Wait(const std::function<void()>& meanwhile);
  // How many messages are kept: they are acknowledged in order.
  std::uint64_t acknowledged();

  static constexpr std::uint64_t kMostUnderWay = 256;

 private:
  std::string Ask(const std::string& call, const std::string& json);
  void TakeAnswer(const NatsMessage& message);
  void WaitUntilFewerThan(std::uint64_t count, const std::function<void()>& meanwhile = {});

  NatsLink& link_;
  const Subjects subjects_;
  const std::string inbox_;
  std::string created_;         // when the stream was
  std::set<std::string> kept_;  // subjects that were published since it is known

  std::mutex mutex_;
  std::condition_variable wake_;
  std::uint64_t run_ = 0;  // answers of earlier ones do not count
  std::uint64_t published_ = 0, acknowledged_ = 0;
  std::uint64_t last_sequence_ = 0;
  bool is_shared_ = false;  // others write
  std::string problem_;     // the first one
  ErrorKind kind_ = ErrorKind::kUnavailable;
};

}  // namespace palpate::web
