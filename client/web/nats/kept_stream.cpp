#include "client/web/nats/kept_stream.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>

#include "common/error/error.h"
#include "common/error/one_line.h"

namespace palpate::web {
namespace {

using Json = nlohmann::json;
using namespace std::chrono_literals;

constexpr auto kPatience = 5s;

[[noreturn]] void Fail(const std::string& why) { throw Error(ErrorKind::kUnavailable, why); }

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
  const auto text =
      link_.Request("$JS.API.STREAM.CREATE." + subjects_.stream(), stream.dump(), kPatience);
  if (!text) Fail("the NATS server has no JetStream, or does not answer");
  const Json answer = Json::parse(*text, nullptr, false);
  if (const std::string problem = ProblemIn(answer); !problem.empty()) Fail(problem);
  const std::string created = answer.value("created", std::string());
  const std::uint64_t last = answer.value("/state/last_seq"_json_pointer, std::uint64_t{0});
  const std::lock_guard lock(mutex_);
  const bool is_known = created == created_ && last == last_sequence_ && problem_.empty() &&
                        under_way_ == 0 && last > 0;
  created_ = created;
  last_sequence_ = last;
  ++run_;
  under_way_ = 0;
  problem_.clear();
  return is_known;
}

void KeptStream::Publish(const std::string& subject, std::string_view bytes) {
  WaitUntilFewerThan(kMostUnderWay);
  std::string reply = inbox_;
  {
    const std::lock_guard lock(mutex_);
    ++under_way_;
    reply += std::to_string(run_);
  }
  if (!link_.Publish(subject, bytes, reply)) Fail("NATS is not reached");
}

void KeptStream::Wait() { WaitUntilFewerThan(1); }

// Patience is for the next answer, not for all of them.
void KeptStream::WaitUntilFewerThan(int count) {
  std::unique_lock lock(mutex_);
  auto end = std::chrono::steady_clock::now() + kPatience;
  int before = under_way_;
  while (problem_.empty() && under_way_ >= count) {
    wake_.wait_for(lock, 100ms);
    const auto now = std::chrono::steady_clock::now();
    if (under_way_ != before) end = now + kPatience;
    before = under_way_;
    if (!link_.is_connected()) problem_ = "NATS is not reached";
    if (now > end) problem_ = "the NATS server does not answer";
  }
  if (!problem_.empty()) Fail(problem_);
}

void KeptStream::TakeAnswer(const NatsMessage& message) {
  std::string problem;
  std::uint64_t sequence = 0;
  if (message.status != 0) {
    problem = "the NATS server has lost the room";
  } else {
    const Json answer = Json::parse(message.bytes, nullptr, false);
    problem = ProblemIn(answer);
    if (problem.empty()) sequence = answer.value("seq", std::uint64_t{0});
  }
  const std::lock_guard lock(mutex_);
  if (message.subject.substr(inbox_.size()) != std::to_string(run_)) return;
  --under_way_;
  last_sequence_ = std::max(last_sequence_, sequence);
  if (problem_.empty()) problem_ = problem;
  wake_.notify_all();
}

}  // namespace palpate::web
