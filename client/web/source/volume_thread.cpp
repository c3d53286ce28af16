#include "client/web/source/volume_thread.h"

#include <chrono>
#include <utility>

namespace palpate::web {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenManifests = 50ms;
constexpr auto kBetweenParts = 10ms;  // of a copy that is not complete
// What was superseded is dropped, and problems are told, also while nothing changes.
constexpr auto kLookEvery = 1000ms;

}  // namespace

void VolumeSignal::Raise() {
  {
    const std::lock_guard lock(mutex_);
    is_raised_ = true;
  }
  wake_.notify_all();
}

void VolumeSignal::Stop() {
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
  }
  wake_.notify_all();
}

bool VolumeSignal::Wait(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  wake_.wait_for(lock, time, [this] { return is_raised_ || is_stopping_; });
  is_raised_ = false;
  return !is_stopping_;
}

bool VolumeSignal::Pause(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, time, [this] { return is_stopping_; });
}

VolumeThread::VolumeThread(client::Client& client, VolumeSignal& signal, bool with_groups,
                           std::function<void(const VolumeNews&)> on_news)
    : client_(client),
      signal_(signal),
      on_news_(std::move(on_news)),
      volume_(with_groups),
      thread_([this] { Run(); }) {}

VolumeThread::~VolumeThread() {
  signal_.Stop();
  thread_.join();
}

void VolumeThread::Run() {
  while (signal_.Wait(kLookEvery)) {
    const auto update = client_.TakeVolumeUpdate();
    VolumeNews news;
    if (update) {
      news = NewsOf(*update);
    } else {
      volume_.Expire(std::chrono::steady_clock::now());
    }
    news.status = client_.volume_status();
    news.bricks_left = news.status.bricks_left;
    on_news_(news);
    if (update && !signal_.Pause(news.manifest ? kBetweenManifests : kBetweenParts)) return;
  }
}

VolumeNews VolumeThread::NewsOf(const client::VolumeUpdate& update) {
  VolumeNews news;
  news.manifest = volume_.Apply(update, std::chrono::steady_clock::now());
  if (update.all) held_lattice_ = update.lattice;
  has_manifest_ = has_manifest_ || news.manifest;
  const bool is_held = held_lattice_ && has_manifest_ && !news.manifest;
  if (is_held || !update.lattice) return news;
  news.lattice = std::exchange(held_lattice_, std::nullopt);
  news.placement = update.placement;
  return news;
}

}  // namespace palpate::web
