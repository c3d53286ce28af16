// A tick never allocates or frees, in free space, in contact, while the surface
// moves, with a ball or a tool, when voxels are edited, while it is suspended, and when the volume
// is replaced.
#include <gtest/gtest.h>

#include <atomic>
#include <cerrno>
#include <memory>
#include <vector>

#include "server/felt/felt_surface.h"
#include "server/pump/tick_outbox.h"
#include "server/servo/servo_tick.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/simulated_device.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace {
thread_local bool counting = false;
std::atomic<long> calls{0};
}  // namespace

// glibc's own, under the names that everything in this program calls.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t size) {
  if (counting) ++calls;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  if (counting) ++calls;
  return __libc_calloc(count, size);
}
void* realloc(void* p, std::size_t size) {
  if (counting) ++calls;
  return __libc_realloc(p, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  if (counting) ++calls;
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** p, std::size_t alignment, std::size_t size) {
  if (counting) ++calls;
  *p = __libc_memalign(alignment, size);
  return *p ? 0 : ENOMEM;
}
void* memalign(std::size_t alignment, std::size_t size) {
  if (counting) ++calls;
  return __libc_memalign(alignment, size);
}
void free(void* p) {
  if (counting && p) ++calls;
  __libc_free(p);
}
}

namespace palpate {
namespace {

std::unique_ptr<Scene> MakeScene(const char* source, double isovalue, std::uint64_t revision) {
  const BuiltinVolume builtin = MakeBuiltin(source);
  auto scene = std::make_unique<Scene>();
  scene->volume = MakeSnapshot(builtin.grid, builtin.metadata, revision);
  scene->isovalue = isovalue;
  scene->settings_revision = revision;
  const double scale = 100.0 / builtin.metadata.size.maxCoeff();
  const Vec3 middle = 0.5 * scale * builtin.metadata.size.cast<double>();
  scene->surface = MakeHapticSurface(*scene->volume, {Mat3::Identity() * scale, -middle}, isovalue,
                                     DecompositionMethod::kTpbcc, revision);
  return scene;
}

// Every second brick without material, as after an edit.
std::unique_ptr<Scene> MakeEdited(const Scene& scene, std::uint64_t revision) {
  auto edited = std::make_unique<Scene>(scene);
  const BrickDirectory& bricks = scene.volume->bricks();
  const auto count = static_cast<std::uint64_t>(bricks.brick_count().prod());
  std::vector<BrickChange> changes;
  for (std::uint64_t n = 0; n < count; n += 2) {
    changes.push_back({bricks.BrickOf(n), Leaf::Constant(LeafType::kFloat, 0.0f)});
  }
  edited->volume = std::make_shared<VolumeSnapshot>(scene.volume->metadata(),
                                                    bricks.With(changes, revision), revision, 1);
  edited->surface.volume = edited->volume.get();
  return edited;
}

// As felt by a ball.
std::unique_ptr<Scene> WithBall(const Scene& scene, double radius_mm, std::uint64_t revision) {
  auto felt = std::make_unique<Scene>(scene);
  const AffineMap X_DI = scene.X_DI();
  const FeltBall ball({radius_mm, X_DI.linear, false}, *scene.volume);
  FeelSurface(X_DI, scene.isovalue, revision, MakeTip({}, {ball}), *felt);
  return felt;
}

// As felt by a rod of balls, some of them points.
std::unique_ptr<Scene> WithTool(const Scene& scene, double radius_mm, std::uint64_t revision) {
  auto felt = std::make_unique<Scene>(scene);
  const AffineMap X_DI = scene.X_DI();
  HeldTool rod;
  for (int n = 0; n < 20; ++n) {
    rod.ball.push_back({Vec3(0.0, 0.0, 2.0 * n), n % 2 == 0 ? radius_mm : 0.0});
  }
  felt->settings.passivity_control = true;
  const FeltBall ball({radius_mm, X_DI.linear, false}, *scene.volume);
  FeelSurface(X_DI, scene.isovalue, revision, MakeTip(rod, {ball}), *felt);
  return felt;
}

TEST(NoAllocation, TheCountSeesAnAllocation) {
  counting = true;
  const auto control = std::make_unique<int>(1);
  counting = false;
  EXPECT_GE(calls.load(), 1);
  calls = 0;
}

TEST(NoAllocation, ATickNeitherAllocatesNorFrees) {
  const DeviceDescription spec = SimulatedDeviceSpec();
  SimulatedDevice device(
      std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, 1));
  device.Start();
  ServoTick tick(device);
  const auto outbox = std::make_unique<TickOutbox>();
  const auto bumps = MakeScene("builtin:bumps:64", 0.5, 1);
  const auto bumps_swollen = MakeScene("builtin:bumps:64", 0.3, 2);
  const auto gyroid = MakeScene("builtin:gyroid:64", 0.5, 3);
  const auto edited = MakeEdited(*bumps, 2);
  const auto ball = WithBall(*bumps, 6.0, 4);
  const auto tool = WithTool(*bumps, 6.0, 5);
  auto suspended = std::make_unique<Scene>(*bumps);
  suspended->forces_off = true;
  TickTime time;
  long contacts = 0, ejecting = 0, edits = 0, with_ball = 0, with_tool = 0;
  calls = 0;
  counting = true;
  for (int n = 0; n < 40000; ++n) {
    const Scene& scene = n / 5000 % 4 == 3   ? *gyroid
                         : n / 5000 % 4 == 2 ? (n % 10 < 5 ? *edited : *bumps)
                         : n % 5000 > 4900   ? *suspended
                         : n / 300 % 4 == 2  ? *ball
                         : n / 300 % 4 == 3  ? *tool
                         : n / 500 % 2 == 1  ? *bumps_swollen
                                             : *bumps;
    time.started_ns += 1'000'000;
    if (n % kKeyframeTicks == 0) outbox->keyframes.TryPush(tick.Keyframe());
    const TickSample sample = tick.Run(scene, time);
    outbox->TryPush(sample);
    outbox->last.Tell(sample);
    contacts += sample.contact;
    edits += sample.contact && &scene == edited.get();
    with_ball += sample.contact && &scene == ball.get();
    with_tool += sample.contact && &scene == tool.get();
    ejecting += sample.mode == ProxyMode::kEjecting;
  }
  counting = false;
  EXPECT_EQ(calls.load(), 0);
  // The run must have been through all of it.
  EXPECT_GT(contacts, 5000);
  EXPECT_GT(ejecting, 0);
  EXPECT_GT(edits, 100);
  EXPECT_GT(with_ball, 100);
  EXPECT_GT(with_tool, 100);
}

}  // namespace
}  // namespace palpate
