#include "client/web/room/kept_stream.h"

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/error/one_line.h"

namespace palpate::web {
namespace {

using Json = nlohmann::json;
using namespace std::chrono_literals;

constexpr auto kPatience = 5s;

[[noreturn]] void Fail(const std::string& why, ErrorKind kind = ErrorKind::kUnavailable) {
  throw Error(kind, why);
}

// Of an answer of the server; empty: none.
std::string ProblemIn(const Json& answer) {
  if (!answer.is_object()) return "the NATS server's answer makes no sense";
  if (!answer.contains("error")) return {};
  return "the NATS server keeps nothing: " +
         OneLine(answer["error"].value("description", std::string("unknown error")));
}

}  // namespace

KeptStream::KeptStream(NatsLink& link, const Subjects& subjects)
    : link_(link), subjects_(subjects), inbox_(link.NewInbox() + ".") {
  link_.Subscribe(inbox_ + "*", [this](const NatsMessage& message) { TakeAnswer(message); });
}

// The answer: JSON, and no error.
std::string KeptStream::Ask(const std::string& call, const std::string& json) {
  const std::string subject = "$JS.API.STREAM." + call + "." + subjects_.stream();
  auto answer = link_.Request(subject, json, kPatience);
  if (!answer) Fail("the NATS server has no JetStream, or does not answer");
  const std::string problem = ProblemIn(Json::parse(*answer, nullptr, false));
  if (!problem.empty()) Fail(problem);
  return std::move(*answer);
}

bool KeptStream::Ensure() {
  const Json stream = {{"name", subjects_.stream()},
                       {"subjects", {subjects_.kept_all()}},
                       {"storage", "memory"},
                       {"retention", "limits"},
                       {"discard", "old"},
                       {"max_msgs_per_subject", 1},
                       {"max_msgs", -1},
                       {"max_bytes", -1},
                       {"max_consumers", 1},
                       {"num_replicas", 1},
                       {"allow_direct", true}};
  const Json answer = Json::parse(Ask("CREATE", stream.dump()));
  const std::string created = answer.value("created", std::string());
  const std::uint64_t last = answer.value("/state/last_seq"_json_pointer, std::uint64_t{0});
  const std::lock_guard lock(mutex_);
  const std::uint64_t messages = answer.value("/state/messages"_json_pointer, std::uint64_t{0});
  const std::uint64_t most = last_sequence_ + published_ - acknowledged_;
  if (published_ != acknowledged_) kept_.clear();  // some were refused
  // Somebody may have purged the stream, or deleted messages.
  const bool lacks_messages = published_ == acknowledged_ && messages < kept_.size();
  const bool is_known = created == created_ && !is_shared_ && !lacks_messages &&
                        last >= last_sequence_ && last <= most;
  if (!is_known) kept_.clear();
  created_ = created;
  last_sequence_ = last;
  is_shared_ = false;
  ++run_;
  published_ = acknowledged_ = 0;
  problem_.clear();
  return is_known;
}

void KeptStream::Purge(const std::string& subjects) {
  Ask("PURGE", Json{{"filter", subjects}}.dump());
  const std::string_view below = std::string_view(subjects).substr(0, subjects.find_first_of("*>"));
  std::erase_if(kept_, [&](const std::string& subject) { return subject.starts_with(below); });
}

std::uint64_t KeptStream::Publish(const std::string& subject, std::string_view bytes) {
  WaitUntilFewerThan(kMostUnderWay);
  std::string reply = inbox_;
  std::uint64_t number = 0;
  {
    const std::lock_guard lock(mutex_);
    number = ++published_;
    reply += std::to_string(run_);
  }
  if (!link_.Publish(subject, bytes, reply)) {
    Fail(!link_.is_connected() ? "NATS is not reached"
                               : "the NATS server's max_payload is less than the " +
                                     std::to_string(bytes.size()) + " bytes of a message");
  }
  kept_.insert(subject);
  return number;
}

std::uint64_t KeptStream::acknowledged() {
  const std::lock_guard lock(mutex_);
  return acknowledged_;
}

void KeptStream::Wait(const std::function<void()>& meanwhile) { WaitUntilFewerThan(1, meanwhile); }

// Patience is for the next answer, not for all of them.
void KeptStream::WaitUntilFewerThan(std::uint64_t count, const std::function<void()>& meanwhile) {
  std::unique_lock lock(mutex_);
  auto end = std::chrono::steady_clock::now() + kPatience;
  std::uint64_t before = acknowledged_;
  while (problem_.empty() && published_ - acknowledged_ >= count) {
    if (wake_.wait_for(lock, 100ms) == std::cv_status::timeout && meanwhile) {
      lock.unlock();
      meanwhile();
      lock.lock();
    }
    const auto now = std::chrono::steady_clock::now();
    if (acknowledged_ != before) end = now + kPatience;
    before = acknowledged_;
    if (!link_.is_connected()) Fail("NATS is not reached");
    if (now > end) Fail("the NATS server does not answer");
  }
  if (!problem_.empty()) Fail(problem_, kind_);
}

void KeptStream::TakeAnswer(const NatsMessage& message) {
  const Json answer = Json::parse(message.bytes, nullptr, false);
  const bool is_lost = message.status != 0;
  const std::string problem = is_lost ? "the NATS server has lost the room" : ProblemIn(answer);
  const std::lock_guard lock(mutex_);
  if (message.subject.substr(inbox_.size()) != std::to_string(run_)) return;
  if (problem.empty()) {
    const std::uint64_t sequence = answer.value("seq", std::uint64_t{0});
    if (sequence != last_sequence_ + 1) is_shared_ = true;
    last_sequence_ = sequence;
    if (problem_.empty()) ++acknowledged_;
  } else if (problem_.empty()) {
    problem_ = problem;
    kind_ = is_lost ? ErrorKind::kUnavailable : ErrorKind::kDiskFull;
  }
  wake_.notify_all();
}

}  // namespace palpate::web
