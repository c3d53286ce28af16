#include "server/app/hand_guide.h"

#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "server/guide/touch_planner.h"

namespace palpate {
namespace {

constexpr int kNice = 10;
constexpr int kRestPerWork = 9;
constexpr std::chrono::milliseconds kLeastRest(20);
constexpr std::chrono::seconds kMostRest(10);

bool HaveSameSurface(const HapticSurface& a, const HapticSurface& b) {
  return a.isovalue == b.isovalue && a.free_side == b.free_side && a.method == b.method &&
         a.X_DI == b.X_DI;
}

}  // namespace

HandGuide::HandGuide(Session& session, TouchPlanInbox& plans)
    : device_(session.device()), plans_(plans), listening_(session, *this) {}

void HandGuide::Start() {
  thread_ = std::thread([this] { Run(); });
}

void HandGuide::Stop() noexcept {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void HandGuide::OnScene(const Scene& scene, std::span<const BrickChange> /*changes*/) {
  // The scene that waited before is freed after the lock.
  std::optional<Felt> felt = Felt{scene.volume, scene.surface, scene.settings.stiffness_n_per_mm};
  {
    const std::lock_guard lock(mutex_);
    if (newest_revision_ == scene.volume->revision() &&
        HaveSameSurface(newest_surface_, scene.surface) &&
        newest_stiffness_n_per_mm_ == felt->stiffness_n_per_mm) {
      return;
    }
    newest_revision_ = scene.volume->revision();
    newest_surface_ = scene.surface;
    newest_surface_.volume = nullptr;
    newest_stiffness_n_per_mm_ = felt->stiffness_n_per_mm;
    waiting_.swap(felt);
  }
  wake_.notify_one();
}

std::optional<HandGuide::Felt> HandGuide::NextFelt() {
  std::unique_lock lock(mutex_);
  wake_.wait(lock, [this] { return stop_ || waiting_; });
  if (stop_) return std::nullopt;
  return std::exchange(waiting_, std::nullopt);
}

void HandGuide::Run() {
  pthread_setname_np(pthread_self(), "palpate-hand");
  // For this thread only. If the system refuses, the thread runs with the priority of the others.
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNice);
  while (std::optional<Felt> felt = NextFelt()) {
    const auto begun = std::chrono::steady_clock::now();
    Plan(*felt);
    felt.reset();
    const std::chrono::nanoseconds worked = std::chrono::steady_clock::now() - begun;
    const auto rest =
        std::clamp<std::chrono::nanoseconds>(kRestPerWork * worked, kLeastRest, kMostRest);
    std::unique_lock lock(mutex_);
    wake_.wait_for(lock, rest, [this] { return stop_; });
  }
}

void HandGuide::Plan(const Felt& felt) noexcept {
  try {
    plans_.Publish(
        std::make_unique<TouchPlan>(PlanTouches(felt.surface, device_, felt.stiffness_n_per_mm)));
  } catch (const std::exception&) {
    // Out of memory: the hand goes on with what it has.
  }
}

}  // namespace palpate
