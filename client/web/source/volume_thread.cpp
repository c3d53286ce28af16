#include "client/web/source/volume_thread.h"

#include <algorithm>
#include <chrono>
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

// Looks instead of being told: a look without news costs next to nothing, and superseded blobs are
// dropped and problems told in any case.
void VolumeThread::Run() {
  std::string problem;
  while (!stopping_) {
    const auto began = std::chrono::steady_clock::now();
    const auto update = client_.TakeVolumeUpdate();
    VolumeNews news;
    if (update) {
      news = NewsOf(*update);
    } else {
      volume_.Expire(began);
    }
    news.status = client_.volume_status();
    if (std::exchange(problem, news.status.problem) != news.status.problem || update)
      on_news_(news);
    // A manifest of a large volume that changes throughout takes half of the time at most.
    const auto work = std::chrono::steady_clock::now() - began;
    std::this_thread::sleep_for(news.manifest
                                    ? std::max<std::chrono::nanoseconds>(kBetweenManifests, work)
                                    : std::chrono::nanoseconds(kBetweenLooks));
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
