#include "client/web/source/volume_thread.h"

#include <chrono>
#include <utility>

namespace palpate::web {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenManifests = 50ms;
constexpr auto kBetweenLooks = 10ms;

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
    const auto update = client_.TakeVolumeUpdate();
    VolumeNews news;
    if (update) {
      news = NewsOf(*update);
    } else {
      volume_.Expire(std::chrono::steady_clock::now());
    }
    news.status = client_.volume_status();
    if (std::exchange(problem, news.status.problem) != news.status.problem || update)
      on_news_(news);
    std::this_thread::sleep_for(news.manifest ? kBetweenManifests : kBetweenLooks);
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
