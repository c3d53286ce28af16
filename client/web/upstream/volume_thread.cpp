#include "client/web/upstream/volume_thread.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

namespace palpate::web {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenManifests = 50ms;
constexpr auto kBetweenLooks = 20ms;

}  // namespace

VolumeThread::VolumeThread(client::Client& client, bool with_groups,
                           std::function<void(const VolumeNews&)> on_news)
    : client_(client),
      on_news_(std::move(on_news)),
      volume_(with_groups),
      thread_([this] { Run(); }) {}

VolumeThread::~VolumeThread() {
  stopping_ = true;
  thread_.join();
}

void VolumeThread::Run() {
  while (!stopping_) {
    const auto began = std::chrono::steady_clock::now();
    bool is_work = true;
    try {
      is_work = Look(began);
    } catch (const std::exception& error) {
      failure_ = error.what();
    }
    // A manifest of a large volume that changes throughout takes half of the time at most.
    const auto work = std::chrono::steady_clock::now() - began;
    std::this_thread::sleep_for(is_work
                                    ? std::max<std::chrono::nanoseconds>(kBetweenManifests, work)
                                    : std::chrono::nanoseconds(kBetweenLooks));
  }
}

// Looks instead of being told: a look without news costs next to nothing, and superseded blobs are
// dropped and problems told in any case. Returns whether there is a manifest.
bool VolumeThread::Look(std::chrono::steady_clock::time_point now) {
  const auto update = client_.TakeVolumeUpdate();
  VolumeNews news;
  if (update) {
    news = NewsOf(*update);
  } else {
    volume_.Expire(now);
  }
  news.status = client_.volume_status();
  news.failure = std::exchange(failure_, {});
  const bool is_other = std::exchange(problem_, news.status.problem) != news.status.problem;
  if (is_other || update || !news.failure.empty()) on_news_(news);
  return news.manifest.has_value();
}

VolumeNews VolumeThread::NewsOf(const client::VolumeUpdate& update) {
  VolumeNews news;
  if (update.all) held_lattice_ = update.lattice;
  news.manifest = volume_.Apply(update, std::chrono::steady_clock::now());
  has_manifest_ = has_manifest_ || news.manifest;
  const bool is_held = held_lattice_ && has_manifest_ && !news.manifest;
  if (is_held || !update.lattice) return news;
  news.lattice = std::exchange(held_lattice_, std::nullopt);
  news.placement = update.placement;
  return news;
}

}  // namespace palpate::web
