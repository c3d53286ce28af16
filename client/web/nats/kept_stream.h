// The stream of a room, which keeps the newest message of each kept subject in the server's memory.
//
// Threads: methods on one, which they let wait. Ownership: borrows the link.
// Errors: kUnavailable: the server does not answer, or has no room for it; kPermissionDenied and
// kConflict by the server's words. After one of them, Ensure() begins anew.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>

#include "client/web/nats/nats_link.h"
#include "client/web/nats/subjects.h"

namespace palpate::web {

class KeptStream {
 public:
  // Before the link's Start.
  KeptStream(NatsLink& link, const Subjects& subjects);
  KeptStream(const KeptStream&) = delete;
  KeptStream& operator=(const KeptStream&) = delete;

  // Creates the stream unless it is there. Returns whether it keeps just what was published here.
  bool Ensure();
  // Waits while kMostUnderWay messages have no answer. Bytes are copied or sent.
  void Publish(const std::string& subject, std::string_view bytes);
  // Until all that was published is kept.
  void Wait();

  static constexpr int kMostUnderWay = 256;

 private:
  void TakeAnswer(const NatsMessage& message);
  void WaitUntilFewerThan(int count);

  NatsLink& link_;
  const Subjects subjects_;
  const std::string inbox_;
  std::string created_;  // when the stream was

  std::mutex mutex_;
  std::condition_variable wake_;
  std::uint64_t run_ = 0;  // answers of earlier ones do not count
  int under_way_ = 0;
  std::uint64_t last_sequence_ = 0;
  std::string problem_;  // the first one
};

}  // namespace palpate::web
