#include "server/simulated_hand/hand_guide.h"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "server/realtime/thread_setup.h"
#include "server/simulated_hand/touch_planner.h"

namespace palpate {
namespace {

constexpr int kNice = 10;
constexpr int kRestPerWork = 9;
constexpr std::chrono::milliseconds kLeastRest(20);
constexpr std::chrono::seconds kMostRest(10);
constexpr std::chrono::milliseconds kMostWayOut(1000);
constexpr std::chrono::milliseconds kLook(2);
// After that, the other volume is not waited for: it could not be published.
constexpr std::chrono::seconds kMostRoom(5);

bool HaveSameSurface(const HapticSurface& a, const HapticSurface& b) {
  return a.isovalue == b.isovalue && a.free_side == b.free_side &&
         a.geometry_revision == b.geometry_revision;
}

}  // namespace

// Of layers the hand plans to touch the outermost one, and with a tool's ball at the tip.
HandGuide::Felt::Felt(const Scene& scene)
    : volume(scene.felt_volume()),
      surface(scene.surface),
      stiffness_n_per_mm(scene.settings.stiffness_n_per_mm) {
  if (scene.tool != nullptr) {
    const FeltTool& felt = scene.tool->felt;
    const auto from_tip = [](const ToolBall& ball) { return ball.p_SBall_mm.norm(); };
    const std::size_t radius = std::ranges::min(felt.tool.balls(), {}, from_tip).radius;
    volume = scene.tool->volume[radius];
    surface = felt.surface[radius];
    has_tool = true;
  }
  if (surface.layers == nullptr) return;
  const HapticLayer& outermost = surface.layers->all().front();
  surface.isovalue = outermost.isovalue;
  surface.layers = nullptr;  // the scene's
  stiffness_n_per_mm = outermost.stiffness_n_per_mm;
}

HandGuide::HandGuide(Session& session, TouchPlanInbox& plans)
    : device_(session.device()), plans_(plans), listening_(session, *this) {}

void HandGuide::Start() {
  {
    const std::lock_guard lock(mutex_);
    is_running_ = true;
  }
  thread_ = std::thread([this] { Run(); });
}

void HandGuide::Stop() noexcept {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();  // MakeRoomFor may wait, too
  thread_.join();
}

void HandGuide::OnScene(const Scene& scene, std::span<const BrickChange> /*changes*/) {
  // The scene that waited before is freed after the lock.
  std::optional<Felt> felt(scene);
  {
    const std::lock_guard lock(mutex_);
    const std::uint64_t loaded = scene.volume->loaded_revision();
    const bool is_other = loaded != std::exchange(loaded_revision_, loaded);
    is_other_volume_ |= is_other;
    if (is_other) room_is_made_until_ = {};
    if (newest_revision_ == scene.volume->revision() &&
        HaveSameSurface(newest_surface_, felt->surface) &&
        newest_stiffness_n_per_mm_ == felt->stiffness_n_per_mm) {
      return;
    }
    newest_revision_ = scene.volume->revision();
    newest_surface_ = felt->surface;
    newest_surface_.volume = nullptr;
    newest_surface_.lattice = {};
    newest_stiffness_n_per_mm_ = felt->stiffness_n_per_mm;
    waiting_.swap(felt);
  }
  wake_.notify_all();
}

std::optional<HandGuide::Felt> HandGuide::NextFelt() {
  std::unique_lock lock(mutex_);
  wake_.wait(lock, [this] { return stop_ || waiting_; });
  if (stop_) return std::nullopt;
  is_other_volume_ = false;
  return std::exchange(waiting_, std::nullopt);
}

void HandGuide::Run() {
  pthread_setname_np(pthread_self(), "palpate-hand");
  SetThreadNice(kNice);
  while (std::optional<Felt> felt = NextFelt()) {
    const auto begun = std::chrono::steady_clock::now();
    Plan(*felt);
    felt.reset();
    const std::chrono::nanoseconds worked = std::chrono::steady_clock::now() - begun;
    const auto rest =
        std::clamp<std::chrono::nanoseconds>(kRestPerWork * worked, kLeastRest, kMostRest);
    std::unique_lock lock(mutex_);
    wake_.wait_for(lock, rest, [this] { return stop_ || is_other_volume_; });
  }
}

void HandGuide::MakeRoomFor(const HapticSurface& surface) {
  std::vector<Vec3> p_DFree_mm = FindFreePlaces(surface, device_);
  std::unique_lock lock(mutex_);
  if (!is_running_ || stop_ || p_DFree_mm.empty()) return;
  const auto now = std::chrono::steady_clock::now();
  room_is_made_until_ = now + kMostRoom;
  newest_revision_ = 0;  // if the other volume does not come, the next scene gets a plan
  plans_.is_out.store(false);
  plans_.Publish(std::make_unique<TouchPlan>(
      TouchPlan{.strokes = {}, .p_DFree_mm = std::move(p_DFree_mm), .makes_room = true}));
  while (!plans_.is_out.load() && std::chrono::steady_clock::now() < now + kMostWayOut) {
    if (wake_.wait_for(lock, kLook, [this] { return stop_; })) return;
  }
}

void HandGuide::Plan(const Felt& felt) noexcept {
  try {
    auto plan =
        std::make_unique<TouchPlan>(PlanTouches(felt.surface, device_, felt.stiffness_n_per_mm));
    plan->turns_stylus = felt.has_tool;
    // The hand is not led back into a volume that goes or has gone.
    const std::lock_guard lock(mutex_);
    const bool makes_room = std::chrono::steady_clock::now() < room_is_made_until_;
    if (!makes_room && !is_other_volume_) plans_.Publish(std::move(plan));
  } catch (const std::exception&) {
    // Out of memory: the hand goes on with what it has.
  }
}

}  // namespace palpate
