#include "client/web/source/calls_thread.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "common/error/error.h"

namespace palpate::web {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kPollEvery{1};

// None if palpated has no such thing or does not answer.
template <class Ask>
auto AnswerOf(const Ask& ask) -> std::optional<decltype(ask())> {
  try {
    return ask();
  } catch (const Error&) {
    return std::nullopt;
  }
}

}  // namespace

CallsThread::CallsThread(client::Client& client, Results results)
    : client_(client), results_(std::move(results)), thread_([this] { Run(); }) {}

CallsThread::~CallsThread() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void CallsThread::WantVolume(std::uint64_t loaded_revision) {
  {
    const std::lock_guard lock(mutex_);
    wanted_volume_ = loaded_revision;
    is_hurried_ = true;
  }
  wake_.notify_all();
}

void CallsThread::Set(const std::string& key, const client::SettingsUpdate& update, Done done) {
  {
    const std::lock_guard lock(mutex_);
    const auto waiting = std::find_if(changes_.begin(), changes_.end(),
                                      [&](const Change& change) { return change.key == key; });
    if (waiting == changes_.end()) {
      changes_.push_back({key, update, {std::move(done)}});
    } else {
      waiting->update = update;
      waiting->done.push_back(std::move(done));
    }
  }
  wake_.notify_all();
}

void CallsThread::Run() {
  Clock::time_point next_poll = Clock::now();
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait_until(lock, next_poll,
                     [this] { return stopping_ || !changes_.empty() || is_hurried_; });
    if (stopping_) return;
    if (!changes_.empty()) {
      const Change change = std::move(changes_.front());
      changes_.erase(changes_.begin());
      lock.unlock();
      Make(change);
      lock.lock();
      continue;
    }
    is_hurried_ = false;
    const auto wanted = wanted_volume_;
    lock.unlock();
    if (wanted) AskVolume(*wanted);
    if (Clock::now() >= next_poll) {
      Poll();
      next_poll = Clock::now() + kPollEvery;
    }
    lock.lock();
  }
}

void CallsThread::Make(const Change& change) {
  std::string error;
  try {
    client_.Set(change.update);
  } catch (const Error& refusal) {
    error = refusal.what();
  }
  for (const Done& done : change.done) done(error);
}

void CallsThread::AskVolume(std::uint64_t wanted) {
  const auto info = AnswerOf([this] { return client_.GetVolume(); });
  if (!info || info->loaded_revision != wanted) return;
  {
    const std::lock_guard lock(mutex_);
    if (wanted_volume_ == wanted) wanted_volume_.reset();
  }
  results_.volume(*info);
}

void CallsThread::Poll() {
  results_.series(AnswerOf([this] { return client_.GetSeries(); }));
  results_.recording(AnswerOf([this] { return client_.GetRecording(); }));
}

}  // namespace palpate::web
