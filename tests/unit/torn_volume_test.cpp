// Editors and servo in one process: every tick sees one state of the volume.
//
// Each brick carries the revision that changed it last in the low bits of its
// first voxel, too small to be felt. A tick that met a brick of another revision
// than its directory says, or freed memory, shows here or under a sanitizer.
#include <gtest/gtest.h>

#include <atomic>
#include <bit>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include "server/servo/servo_tick.h"
#include "server/session/session.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/simulated_device.h"

namespace palpate {
namespace {

constexpr std::uint32_t kMask = 0xfff;  // of 23 bits: 5e-4 of the value at most

std::uint32_t MarkOf(const Leaf& leaf) { return std::bit_cast<std::uint32_t>(leaf[0]) & kMask; }

LeafPtr Marked(const Leaf& leaf, std::uint64_t revision) {
  Brick values = leaf.Floats();
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(values[0]) & ~kMask;
  values[0] = std::bit_cast<float>(bits | (static_cast<std::uint32_t>(revision) & kMask));
  return leaf.With(values);
}

// A brush of 2³ bricks (16³ voxels), or with `all` the whole volume as a frame
// does: the same values with the mark of the revision that they lead to.
std::vector<BrickChange> Marking(const VolumeSnapshot& volume, std::mt19937& random, bool all) {
  const BrickDirectory& bricks = volume.bricks();
  const std::uint64_t revision = volume.revision() + 1;
  const Vec3i last = bricks.brick_count() - Vec3i::Ones();
  const Vec3i corner(static_cast<int>(random() % last.x()), static_cast<int>(random() % last.y()),
                     static_cast<int>(random() % last.z()));
  const Vec3i low = all ? Vec3i::Zero().eval() : corner;
  const Vec3i high = all ? last : Vec3i(corner + Vec3i::Ones());
  std::vector<BrickChange> changes;
  for (int a = low.x(); a <= high.x(); ++a) {
    for (int b = low.y(); b <= high.y(); ++b) {
      for (int c = low.z(); c <= high.z(); ++c) {
        changes.push_back({{a, b, c}, Marked(*bricks.At({a, b, c}), revision)});
      }
    }
  }
  return changes;
}

// Bricks whose mark is not that of the revision at which they changed.
int TornBricks(const VolumeSnapshot& volume) {
  int torn = 0;
  const BrickDirectory& bricks = volume.bricks();
  const auto count = static_cast<std::uint64_t>(bricks.brick_count().prod());
  for (std::uint64_t n = 0; n < count; ++n) {
    const Vec3i brick = bricks.BrickOf(n);
    const std::uint64_t revision = bricks.RevisionOf(brick);
    // What was loaded has no marks.
    if (revision == volume.loaded_revision()) continue;
    torn += MarkOf(*bricks.At(brick)) != (revision & kMask);
    torn += revision > volume.revision();
  }
  return torn;
}

TEST(TornVolume, NoTickSeesOne) {
  SceneInbox inbox;
  const auto outbox = std::make_unique<TickOutbox>();
  Pump pump(*outbox, inbox);
  const DeviceDescription spec = SimulatedDeviceSpec();
  SimulatedDevice device(
      std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, 1));
  Session session(spec, inbox, pump, VolumeLoader{});
  session.Load(
      {.source = "builtin:bumps:40"}, [](std::string_view, double) {}, [] { return false; });
  device.Start();
  ServoTick tick(device);

  std::atomic<bool> stop{false};
  std::atomic<long> published{0};
  std::vector<std::thread> editors;
  for (unsigned n = 0; n < 5; ++n) {
    editors.emplace_back([&, n] {
      std::mt19937 random(n);
      while (!stop.load()) {
        session.store().Edit(
            [&](const auto& present) { return Marking(*present, random, n == 0); });
        ++published;
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
    });
  }
  long torn = 0, inside = 0, contacts = 0, backwards = 0;
  std::uint64_t volumes = 0, last_revision = 0;
  TickTime time;
  const auto met_enough = [&] { return volumes > 200 && published > 500; };
  for (int n = 0; n < 20000 || (n < 2'000'000 && !met_enough()); ++n) {
    const Scene& scene = *inbox.Acquire();
    time.started_ns += 1'000'000;
    const TickSample sample = tick.Run(scene, time);
    torn += TornBricks(*scene.volume);
    backwards += sample.volume_revision < last_revision;
    volumes += sample.volume_revision != last_revision;
    last_revision = sample.volume_revision;
    contacts += sample.contact;
    const bool settled = sample.mode == ProxyMode::kFree || sample.mode == ProxyMode::kConstrained;
    inside += settled && sample.density > sample.isovalue;
    if (n % 16 == 0) std::this_thread::sleep_for(std::chrono::microseconds(500));
  }
  stop = true;
  for (std::thread& editor : editors) editor.join();
  inbox.ReaderStopped();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(inside, 0);
  EXPECT_EQ(backwards, 0);
  // The run was one.
  EXPECT_GT(contacts, 2000);
  EXPECT_GT(published.load(), 500);
  EXPECT_GT(volumes, 200u);
  EXPECT_EQ(session.volume().volume->revision(), 1u + static_cast<std::uint64_t>(published.load()));
  std::printf("%ld publications, %lu volumes met in 20000 ticks, %ld in contact\n",
              published.load(), static_cast<unsigned long>(volumes), contacts);
}

TEST(TornVolume, TheCheckSeesATornBrick) {
  const auto bricks = BrickDirectory(Vec3i(16, 8, 8), [](const Vec3i&) {
    Brick brick{};
    brick.fill(0.5f);
    return Leaf::Of(LeafType::kFloat, brick);
  });
  const std::vector<BrickChange> right = {{Vec3i(1, 0, 0), Marked(*bricks.At({1, 0, 0}), 2)}};
  const std::vector<BrickChange> wrong = {{Vec3i(1, 0, 0), Marked(*bricks.At({1, 0, 0}), 3)}};
  VolumeMetadata metadata;
  metadata.size = Vec3i(16, 8, 8);
  EXPECT_EQ(TornBricks(VolumeSnapshot(metadata, bricks.With(right, 2), 2, 1)), 0);
  EXPECT_EQ(TornBricks(VolumeSnapshot(metadata, bricks.With(wrong, 2), 2, 1)), 1);
}

}  // namespace
}  // namespace palpate
