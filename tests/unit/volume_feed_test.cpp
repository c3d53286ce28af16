// What one subscriber of the volume gets, and that the copy it makes of it is the
// volume.
#include "server/volume_stream/volume_feed.h"

#include <gtest/gtest.h>

#include <map>

#include "client/sdk/volume_mirror.h"
#include "common/error/error.h"
#include "server/volume/snapshot/brick_packer.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

using testing::DifferentVoxels;
using testing::EditableSession;
using testing::Refusal;

constexpr std::uint64_t kDaemon = 77;
const Vec3i kSize(40, 33, 50);

struct Counts {
  int lattices = 0, placements = 0, overviews = 0, completes = 0;
  std::uint64_t bricks = 0, tiles = 0;
};

// No brick has one value.
float Varied(int i, int j, int k) {
  return static_cast<float>((7 * i + 13 * j + 29 * k) % 64) / 64;
}

class VolumeFeedTest : public ::testing::Test {
 protected:
  void SetUp() override { LoadBall(); }

  void Load(const Vec3i& size, const std::function<float(int, int, int)>& value) {
    data_.LoadMade(size, value);
    Keep();
  }
  // A ball in the background.
  void LoadBall(const Vec3i& size = kSize) {
    Load(size, [](int i, int j, int k) {
      const float r = (Vec3(i, j, k) - Vec3(16, 16, 16)).norm();
      return r < 14.0f ? 1.0f - r / 14.0f : 0.0f;
    });
  }
  void Edit(int edge = 16) {
    data_.RandomEdit(random_, edge);
    Keep();
  }
  void Paint(const Vec3i& from, const Vec3i& end, float value) {
    data_.session().store().Edit([&](const auto& present) {
      return testing::PaintedBox(present->bricks(), from, end, [&] { return value; });
    });
    Keep();
  }
  void PaintNoise(const Vec3i& from, const Vec3i& end) {
    data_.session().store().Edit([&](const auto& present) {
      return testing::PaintedBox(present->bricks(), from, end,
                                 [&] { return static_cast<float>(random_() % 1000) * 1e-3f; });
    });
    Keep();
  }
  void Move(double x_mm) {
    data_.session().Move([&](const VolumeState& state) {
      VolumePlace moved = state.registration;
      moved.X_DW.translation.x() = x_mm;
      return moved;
    });
  }
  VolumeNow Now() const {
    const VolumeState state = data_.session().volume();
    return {state.volume, state.X_DI, state.settings_revision, state.patient_axes, replayed_};
  }
  void Keep() { kept_[data_.volume()->revision()] = data_.volume(); }
  VolumeFeed MakeFeed(std::optional<VolumeRevision> resume = {}, std::uint64_t window = 64) {
    return VolumeFeed({window, resume}, kDaemon, Now(), time_);
  }

  // The next message, applied and acknowledged.
  bool Pass(VolumeFeed& feed, bool acknowledge = true) {
    while (feed.HasWork(Now())) {
      const std::optional<VolumeMessage> message = feed.Step(Now(), time_);
      if (!message) continue;
      EXPECT_EQ(message->number, ++number_);
      Take(message->event);
      if (acknowledge) feed.Acknowledge(message->number, time_);
      return true;
    }
    return false;
  }
  // Without a look at each voxel.
  void PassAllUnchecked(VolumeFeed& feed) {
    while (feed.HasWork(Now())) {
      const std::optional<VolumeMessage> message = feed.Step(Now(), time_);
      if (!message) continue;
      number_ = message->number;
      mirror_.Apply(message->event);
      feed.Acknowledge(number_, time_);
    }
  }
  void PassAll(VolumeFeed& feed) {
    while (Pass(feed)) {
    }
  }
  // One message; an edit comes before it is acknowledged.
  void PassSlowly(VolumeFeed& feed, int edge, std::chrono::milliseconds pause) {
    ASSERT_TRUE(Pass(feed, false));
    Edit(edge);
    time_ += pause;
    feed.LetGo(Now(), time_);
    feed.Acknowledge(number_, time_);
  }
  bool IsFreed(const std::weak_ptr<const VolumeSnapshot>& volume) {
    return test::Eventually([&] {
      data_.session().retired().WaitForFreed(std::chrono::seconds(60));
      return volume.expired();
    });
  }
  // All of a new feed; counts what it sends.
  void PassAllOfNew(std::optional<VolumeRevision> resume = {}) {
    counts_ = {};
    number_ = 0;
    VolumeFeed feed = MakeFeed(resume);
    PassAll(feed);
    ExpectNewest();
  }
  void Take(const VolumeEvent& event) {
    mirror_.Apply(event);
    counts_.lattices += std::holds_alternative<VolumeLattice>(event);
    counts_.placements += std::holds_alternative<VolumePlacement>(event);
    counts_.overviews += std::holds_alternative<VolumeOverview>(event);
    if (const auto* bricks = std::get_if<VolumeBricks>(&event)) {
      counts_.bricks += bricks->numbers.size();
      counts_.tiles += bricks->tiles.size();
      EXPECT_LE(bricks->numbers.size() * kBrickVoxels * VoxelBytes(bricks->type),
                BrickPacker::kBytesPerMessage);
    }
    if (const auto* complete = std::get_if<VolumeComplete>(&event)) {
      ++counts_.completes;
      EXPECT_EQ(complete->revision.daemon_id, kDaemon);
      const auto& volume = kept_.at(complete->revision.volume_revision);
      EXPECT_EQ(DifferentVoxels(mirror_, *volume), 0u);
    }
  }
  void ExpectNewest() {
    ASSERT_TRUE(mirror_.is_complete());
    EXPECT_EQ(mirror_.resume()->volume_revision, data_.volume()->revision());
    EXPECT_EQ(DifferentVoxels(mirror_, *data_.volume()), 0u);
    EXPECT_EQ(mirror_.placement()->device_from_index.translation, Now().X_DI.translation);
  }

  mutable EditableSession data_;
  bool replayed_ = false;
  std::mt19937 random_{1};
  std::map<std::uint64_t, std::shared_ptr<const VolumeSnapshot>> kept_;
  client::VolumeMirror mirror_;
  Counts counts_;
  std::uint64_t number_ = 0;
  VolumeFeed::Clock::time_point time_{};
};

TEST_F(VolumeFeedTest, WindowsAndRevisionsOutOfRangeAreRefused) {
  const std::uint64_t newest = data_.volume()->revision();
  const auto make = [&](std::uint64_t window, std::optional<VolumeRevision> resume) {
    const VolumeFeedOptions options{window, resume};
    return Refusal([&] { VolumeFeed(options, kDaemon, Now(), time_); });
  };
  for (const std::uint64_t good : {0, 1, 4, 64}) EXPECT_FALSE(make(good, {}));
  for (const std::uint64_t bad : {std::uint64_t{65}, ~std::uint64_t{0}}) {
    EXPECT_EQ(make(bad, {}), ErrorKind::kInvalidArgument);
  }
  EXPECT_FALSE(make(4, VolumeRevision{kDaemon, newest}));
  EXPECT_FALSE(make(4, VolumeRevision{kDaemon, 0}));
  EXPECT_FALSE(make(4, VolumeRevision{kDaemon + 1, newest + 1}));
  EXPECT_EQ(make(4, VolumeRevision{kDaemon, newest + 1}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(make(4, VolumeRevision{kDaemon, ~std::uint64_t{0}}), ErrorKind::kInvalidArgument);
}

TEST_F(VolumeFeedTest, AFreshCopyComesInOrderWithoutTheBackground) {
  VolumeFeed feed = MakeFeed();
  std::vector<std::size_t> kinds;
  std::vector<std::uint64_t> numbers;
  std::uint64_t left = ~std::uint64_t{0};
  while (feed.HasWork(Now())) {
    const auto message = feed.Step(Now(), time_);
    if (!message) continue;
    Take(message->event);
    kinds.push_back(message->event.index());
    if (const auto* bricks = std::get_if<VolumeBricks>(&message->event)) {
      numbers.insert(numbers.end(), bricks->numbers.begin(), bricks->numbers.end());
      EXPECT_LT(bricks->bricks_left, left);
      left = bricks->bricks_left;
    }
  }
  // As VolumeEvent lists them: lattice, placement, overview, bricks, complete.
  EXPECT_TRUE(std::is_sorted(kinds.begin(), kinds.end()));
  EXPECT_EQ(counts_.lattices, 1);
  EXPECT_EQ(counts_.placements, 1);
  EXPECT_EQ(counts_.overviews, 1);
  EXPECT_EQ(counts_.completes, 1);
  EXPECT_EQ(left, 0u);
  EXPECT_TRUE(std::is_sorted(numbers.begin(), numbers.end()));
  std::uint64_t with_values = 0;
  const BrickDirectory& bricks = data_.volume()->bricks();
  for (std::uint64_t n = 0; n < mirror_.lattice()->Bricks(); ++n) {
    with_values += bricks.At(bricks.BrickOf(n))->Floats() != Brick{};
  }
  EXPECT_EQ(numbers.size(), with_values);
  EXPECT_LT(with_values, mirror_.lattice()->Bricks());
  ExpectNewest();
}

TEST_F(VolumeFeedTest, TheLatticeAndOverviewAreThoseOfTheVolume) {
  VolumeFeed feed = MakeFeed();
  PassAll(feed);
  const VolumeMetadata& metadata = data_.volume()->metadata();
  EXPECT_EQ(mirror_.lattice()->size, metadata.size);
  EXPECT_EQ(mirror_.lattice()->source, "made");
  EXPECT_EQ(mirror_.lattice()->value_max, metadata.value_max);
  EXPECT_EQ(mirror_.lattice()->loaded_revision, data_.volume()->loaded_revision());
  EXPECT_EQ(mirror_.lattice()->X_WI.linear, metadata.WorldFromIndex().linear);
  ASSERT_EQ(mirror_.overview_size(), Vec3i(10, 9, 13));
  std::size_t n = 0;
  testing::ForEachVoxel(mirror_.overview_size(), [&](const Vec3i& block) {
    double sum = 0.0;
    int count = 0;
    for (int v = 0; v < 64; ++v) {
      const Vec3i p = 4 * block + Vec3i(v / 16, v / 4 % 4, v % 4);
      if ((p.array() >= kSize.array()).any()) continue;
      sum += mirror_.bricks().Value(p.x(), p.y(), p.z());
      ++count;
    }
    ASSERT_EQ(mirror_.overview()[n++], static_cast<float>(sum / count));
  });
}

// Leaves of all types, of one value and of several, in any order; then edits that change types.
TEST_F(VolumeFeedTest, BricksComeInTheirOwnTypeAndRunsOfOneValueAsTiles) {
  VolumeMetadata metadata;
  metadata.size = {30, 44, 60};
  metadata.source = "made";
  metadata.value_max = 99.0;
  metadata.is_level_set = true;  // the background is 99
  const LeafPtr constants[] = {
      Leaf::Constant(LeafType::kInt16, 99.0f), Leaf::Constant(LeafType::kInt16, -7.0f),
      Leaf::Constant(LeafType::kFloat, -7.0f), Leaf::Constant(LeafType::kFloat, 0.1f)};
  std::map<LeafType, std::uint64_t> sent, made;
  std::uint64_t tile_bricks = 0, constant = 0;
  data_.session().PublishVolume({}, metadata, BrickDirectory(metadata.size, [&](const Vec3i&) {
                                  if (random_() % 3 != 0) {
                                    const std::size_t which = random_() % 4;
                                    constant += which > 0;
                                    return constants[which];
                                  }
                                  const LeafType type = kLeafTypes[random_() % 4];
                                  ++made[type];
                                  Brick values;
                                  for (float& value : values) {
                                    value = static_cast<float>(random_() % 100);
                                  }
                                  return Leaf::Of(type, values);
                                }));
  Keep();
  VolumeFeed feed = MakeFeed();
  while (feed.HasWork(Now())) {
    const auto message = feed.Step(Now(), time_);
    if (!message) continue;
    number_ = message->number;
    feed.Acknowledge(number_, time_);
    Take(message->event);
    if (const auto* bricks = std::get_if<VolumeBricks>(&message->event)) {
      sent[bricks->type] += bricks->numbers.size();
      for (const VolumeTile& tile : bricks->tiles) tile_bricks += tile.bricks.count;
    }
  }
  ExpectNewest();
  EXPECT_EQ(sent, made);
  EXPECT_EQ(tile_bricks, constant);
  EXPECT_LT(counts_.tiles, constant);
  for (int n = 0; n < 20; ++n) {
    Edit(20);
    PassAll(feed);
  }
  ExpectNewest();
}

// What the type and the tiles of a volume are does not depend on who was there when.
TEST_F(VolumeFeedTest, AnEditChangesNeitherTheTypeNorWhatIsATile) {
  VolumeMetadata metadata;
  metadata.size = {16, 16, 32};
  metadata.source = "made";
  Brick noise;
  for (float& value : noise) value = static_cast<float>(random_() % 100);
  data_.session().PublishVolume({}, metadata, BrickDirectory(metadata.size, [&](const Vec3i&) {
                                  return Leaf::Of(LeafType::kInt16, noise);
                                }));
  Paint(Vec3i::Zero(), Vec3i(8, 8, 3), 0.5f);
  Paint(Vec3i(8, 0, 0), Vec3i(16, 16, 32), 7.0f);
  PassAllOfNew();
  EXPECT_EQ(mirror_.lattice()->type, LeafType::kInt16);
  EXPECT_EQ(mirror_.bricks().At(0)->type(), LeafType::kFloat);
  EXPECT_EQ(counts_.bricks, 8u);
  EXPECT_EQ(counts_.tiles, 1u);
  // Back to background: nothing of it is sent.
  Paint(Vec3i(8, 0, 0), Vec3i(16, 16, 32), 0.0f);
  PassAllOfNew();
  EXPECT_EQ(counts_.bricks, 8u);
  EXPECT_EQ(counts_.tiles, 0u);
}

// A lattice of 2^30 voxels with one value in half of it: a tile per row at most, in few messages.
TEST_F(VolumeFeedTest, ALargeInsideCostsAFewTiles) {
  VolumeMetadata metadata;
  metadata.size = {1024, 1024, 1024};
  metadata.source = "made";
  const LeafPtr far = Leaf::Constant(LeafType::kUint8, 0.0f);
  const LeafPtr inside = Leaf::Constant(LeafType::kUint8, 1.0f);
  data_.session().PublishVolume({}, metadata,
                                BrickDirectory(metadata.size, [&](const Vec3i& brick) {
                                  return brick.x() < 64 ? inside : far;
                                }));
  VolumeFeed feed = MakeFeed();
  PassAllUnchecked(feed);
  ASSERT_TRUE(mirror_.is_complete());
  EXPECT_EQ(mirror_.lattice()->type, LeafType::kUint8);
  EXPECT_EQ(mirror_.bricks().Value(511, 1023, 0), 1.0f);
  EXPECT_EQ(mirror_.bricks().Value(512, 0, 0), 0.0f);
  EXPECT_LE(number_, 3u + 64u * 128u * 128u / 65536u);
  EXPECT_TRUE(mirror_.bricks().Only(Vec3i(7, 15, 15)));
}

// A sparse lattice of 2^30 voxels: its overview would be 64 MB.
TEST_F(VolumeFeedTest, AHugeLatticeHasNoOverview) {
  VolumeMetadata metadata;
  metadata.size = {1024, 1024, 1024};
  metadata.source = "made";
  const LeafPtr far = Leaf::Constant(LeafType::kFloat, 0.0f), near = testing::FilledLeaf(1.0f);
  data_.session().PublishVolume({}, metadata,
                                BrickDirectory(metadata.size, [&](const Vec3i& brick) {
                                  return (brick.array() == 100).all() ? near : far;
                                }));
  VolumeFeed feed = MakeFeed();
  int events = 0;
  while (feed.HasWork(Now())) {
    const std::optional<VolumeMessage> message = feed.Step(Now(), time_);
    if (!message) continue;
    feed.Acknowledge(message->number, time_);
    ASSERT_FALSE(std::holds_alternative<VolumeOverview>(message->event));
    ++events;
  }
  EXPECT_GE(events, 3);  // the lattice, the brick, the end
}

TEST_F(VolumeFeedTest, AnOverviewOfManyBlocksComesInPieces) {
  Load(Vec3i(2, 3, 4 * 140000), [](int, int, int k) { return (k / 4 % 7) / 7.0f; });
  PassAllOfNew();
  EXPECT_EQ(counts_.overviews, 3);
  ASSERT_EQ(mirror_.overview().size(), 140000u);
  for (std::size_t k = 0; k < 140000; ++k) ASSERT_EQ(mirror_.overview()[k], (k % 7) / 7.0f);
}

TEST_F(VolumeFeedTest, NothingIsSentBeyondTheWindow) {
  Load(Vec3i(64, 64, 64), Varied);
  for (const std::uint64_t asked : {1, 3, 0}) {
    const std::uint64_t window = asked == 0 ? 4 : asked;  // as VolumeFeedOptions says
    VolumeFeed feed = MakeFeed({}, asked);
    number_ = 0;
    for (std::uint64_t n = 0; n < window; ++n) EXPECT_TRUE(Pass(feed, false));
    EXPECT_FALSE(feed.HasWork(Now()));
    feed.Acknowledge(0, time_);
    EXPECT_FALSE(feed.HasWork(Now()));
    feed.Acknowledge(1, time_);
    EXPECT_TRUE(Pass(feed, false));
    EXPECT_FALSE(feed.HasWork(Now()));
    // Of what was not sent yet: as if all that was sent.
    feed.Acknowledge(1000, time_);
    for (std::uint64_t n = 0; n < window; ++n) EXPECT_TRUE(Pass(feed, false));
    EXPECT_FALSE(feed.HasWork(Now()));
    feed.Acknowledge(1, time_);
    EXPECT_FALSE(feed.HasWork(Now()));
  }
}

TEST_F(VolumeFeedTest, ReloadsAndMovesAndResumesAtAnyTime) {
  auto feed = std::make_unique<VolumeFeed>(MakeFeed());
  int resumes = 0;
  for (int n = 0; n < 1000; ++n) {
    const auto chance = random_() % 100;
    if (chance < 30) Edit();
    if (chance == 30) LoadBall(Vec3i(2 + random_() % 30, 2 + random_() % 30, 2 + random_() % 30));
    if (chance == 31) Move(static_cast<double>(random_() % 1000));
    if (chance == 32) {
      feed = std::make_unique<VolumeFeed>(MakeFeed(mirror_.resume(), 1 + random_() % 64));
      number_ = 0;
      ++resumes;
    }
    if (chance == 33) time_ += VolumeFeed::kStall * 2;
    feed->LetGo(Now(), time_);
    if (chance >= 34) Pass(*feed);
  }
  PassAll(*feed);
  ExpectNewest();
  EXPECT_GT(counts_.lattices, 4);
  EXPECT_GT(resumes, 4);
  EXPECT_GT(counts_.completes, 30);
}

TEST_F(VolumeFeedTest, SkipsWhatLiesBetween) {
  VolumeFeed feed = MakeFeed();
  PassAll(feed);
  counts_ = {};
  for (int n = 0; n < 500; ++n) Edit(8);
  PassAll(feed);
  ExpectNewest();
  EXPECT_EQ(counts_.completes, 1);
  EXPECT_LE(counts_.bricks, mirror_.lattice()->Bricks());
}

// A replay begins or ends in the midst of a transfer.
TEST_F(VolumeFeedTest, TheLastPlacementSaysWhetherTheVoxelsAreAReplays) {
  Load(Vec3i(70, 70, 70), Varied);
  VolumeFeed feed = MakeFeed();
  std::map<std::uint64_t, bool> replayed{{data_.volume()->revision(), false}};
  for (int n = 0; n < 400; ++n) {
    if (random_() % 4 == 0) {
      replayed_ = random_() % 2 == 0;
      Edit(70);
      replayed[data_.volume()->revision()] = replayed_;
    }
    if (random_() % 3 == 0) Move(static_cast<double>(n));
    const int completes = counts_.completes;
    Pass(feed);
    if (counts_.completes == completes) continue;
    EXPECT_EQ(mirror_.placement()->replayed, replayed.at(mirror_.resume()->volume_revision));
  }
  EXPECT_GT(counts_.completes, 20);
  PassAll(feed);
  ExpectNewest();
}

TEST_F(VolumeFeedTest, WhoReadsNothingHoldsAnOldVolumeForTwoSeconds) {
  VolumeFeed feed = MakeFeed({}, 2);
  Pass(feed, false);
  Pass(feed, false);
  const std::weak_ptr<const VolumeSnapshot> first = data_.volume();
  kept_.clear();
  // The newest is not "old": it costs nothing to hold it.
  time_ += VolumeFeed::kStall * 10;
  feed.LetGo(Now(), time_);
  EXPECT_NE(feed.held(), nullptr);
  data_.RandomEdit(random_);
  EXPECT_FALSE(first.expired());
  feed.LetGo(Now(), time_);
  EXPECT_TRUE(IsFreed(first));
  EXPECT_EQ(feed.held(), nullptr);
  for (int n = 0; n < 100; ++n) {
    data_.RandomEdit(random_);
    feed.LetGo(Now(), time_);
    EXPECT_EQ(feed.held(), nullptr);
  }
  // And then catches up.
  Keep();
  feed.Acknowledge(2, time_);
  PassAll(feed);
  ExpectNewest();
  EXPECT_EQ(counts_.lattices, 1);
}

// A message just before two seconds are over, again and again.
TEST_F(VolumeFeedTest, WhoReadsVerySlowlyHoldsAnOldVolumeForThirtySeconds) {
  Load(Vec3i(256, 64, 64), Varied);
  VolumeFeed feed = MakeFeed({}, 1);
  Pass(feed, false);
  const std::weak_ptr<const VolumeSnapshot> first = data_.volume();
  kept_.clear();
  data_.RandomEdit(random_);
  const auto end = time_ + VolumeFeed::kLongestOld + VolumeFeed::kStall;
  while (time_ < end) {
    feed.LetGo(Now(), time_);
    time_ += VolumeFeed::kStall - std::chrono::milliseconds(100);
    feed.Acknowledge(number_, time_);
    EXPECT_TRUE(Pass(feed, false));
  }
  feed.LetGo(Now(), time_);
  EXPECT_TRUE(IsFreed(first));
}

// A message every three seconds, while somebody edits all the time: each belongs to a revision of
// its own.
TEST_F(VolumeFeedTest, WhoReadsVerySlowlyGetsThereAllTheSame) {
  Load(Vec3i(128, 64, 64), Varied);
  VolumeFeed feed = MakeFeed({}, 1);
  for (int round = 0; round < 2; ++round) {
    const int before = counts_.completes;
    for (int n = 0; n < 200 && counts_.completes == before; ++n) {
      PassSlowly(feed, 8, std::chrono::seconds(3));
      EXPECT_EQ(feed.held(), nullptr);
    }
    EXPECT_EQ(counts_.completes, before + 1);
    // Now all of it is another, on top of a copy that is whole.
    PaintNoise(Vec3i::Zero(), Vec3i(128, 64, 64));
  }
  EXPECT_EQ(counts_.lattices, 1);
  EXPECT_EQ(counts_.overviews, 1);
  // 1024 bricks twice, and what was edited meanwhile.
  EXPECT_LT(counts_.bricks, 3 * 1024u);
  PassAll(feed);
  ExpectNewest();
}

TEST_F(VolumeFeedTest, WhoReadsSlowlyGetsWhatItBegan) {
  VolumeFeed feed = MakeFeed({}, 1);
  const std::uint64_t begun = data_.volume()->revision();
  while (counts_.completes == 0 && !HasFatalFailure()) {
    PassSlowly(feed, 16, std::chrono::milliseconds(1900));
  }
  EXPECT_EQ(mirror_.resume()->volume_revision, begun);
  EXPECT_EQ(counts_.lattices, 1);
}

TEST_F(VolumeFeedTest, AnotherVolumeLetsGoOfTheOldOneAtOnce) {
  VolumeFeed feed = MakeFeed();
  Pass(feed);
  Pass(feed);
  const std::weak_ptr<const VolumeSnapshot> first = data_.volume();
  kept_.clear();
  LoadBall(Vec3i(9, 9, 9));
  feed.LetGo(Now(), time_);
  EXPECT_TRUE(IsFreed(first));
  PassAll(feed);
  ExpectNewest();
  EXPECT_EQ(mirror_.lattice()->size, Vec3i(9, 9, 9));
}

TEST_F(VolumeFeedTest, ATransferGivenUpLeavesNothingBehind) {
  // All bricks have values; half of the copy comes, and then all is cleared.
  Load(Vec3i(64, 64, 64), Varied);
  VolumeFeed feed = MakeFeed();
  while (counts_.bricks < 256) Pass(feed);
  Paint(Vec3i::Zero(), Vec3i(64, 64, 64), 0.0f);
  time_ += VolumeFeed::kStall * 2;
  feed.LetGo(Now(), time_);
  PassAll(feed);
  ExpectNewest();
}

// With and without a change meanwhile.
TEST_F(VolumeFeedTest, AResumedCopyGetsOnlyWhatChanged) {
  PassAllOfNew();
  for (const std::uint64_t changed : {2u, 0u}) {
    if (changed > 0) PaintNoise(Vec3i(8, 8, 8), Vec3i(16, 16, 24));
    PassAllOfNew(mirror_.resume());
    EXPECT_EQ(counts_.lattices, 0);
    EXPECT_EQ(counts_.placements, 1);
    EXPECT_EQ(counts_.bricks, changed);
    EXPECT_EQ(counts_.completes, 1);
  }
}

TEST_F(VolumeFeedTest, ACopyOfAnotherVolumeOrDaemonIsReplaced) {
  PassAllOfNew();
  LoadBall();
  for (const VolumeRevision& resume :
       {*mirror_.resume(), VolumeRevision{kDaemon + 1, data_.volume()->revision()},
        VolumeRevision{kDaemon, 0}}) {
    PassAllOfNew(resume);
    EXPECT_EQ(counts_.lattices, 1);
  }
}

TEST_F(VolumeFeedTest, AMoveIsAPlacementAlone) {
  VolumeFeed feed = MakeFeed();
  PassAll(feed);
  counts_ = {};
  Move(12.5);
  PassAll(feed);
  EXPECT_EQ(counts_.placements, 1);
  EXPECT_EQ(counts_.bricks, 0u);
  EXPECT_EQ(counts_.completes, 0);
  EXPECT_EQ(mirror_.placement()->settings_revision, Now().settings_revision);
  ExpectNewest();
  // Settings that move nothing.
  data_.session().SetForcesOff(true);
  EXPECT_FALSE(feed.HasWork(Now()));
}

TEST_F(VolumeFeedTest, AnAnswerToWhereThePatientFacesIsAPlacementAlone) {
  VolumeFeed feed = MakeFeed();
  PassAll(feed);
  EXPECT_EQ(mirror_.placement()->patient_axes, "");
  EXPECT_FALSE(mirror_.placement()->patient_axes_answered);
  counts_ = {};
  data_.session().Move([](const VolumeState& state) { return state.registration; }, {},
                       PatientFacing{"+y", "+z"});
  PassAll(feed);
  EXPECT_EQ(counts_.placements, 1);
  EXPECT_EQ(counts_.lattices + counts_.completes, 0);
  EXPECT_EQ(mirror_.placement()->patient_axes, "RAS");
  EXPECT_TRUE(mirror_.placement()->patient_axes_answered);
}

TEST_F(VolumeFeedTest, BricksComeWhileTheVolumeIsMovedAllTheTime) {
  VolumeFeed feed = MakeFeed();
  double x_mm = 0.0;
  int messages = 0;
  while (counts_.completes == 0 && messages < 1000) {
    Move(x_mm += 0.1);
    messages += Pass(feed);
  }
  EXPECT_EQ(counts_.completes, 1);
  EXPECT_GT(counts_.placements, 2);
  PassAll(feed);
  ExpectNewest();
}

TEST_F(VolumeFeedTest, NegativeZeroIsNoBackground) {
  Load(Vec3i(16, 16, 16), [](int i, int, int) { return i < 8 ? -0.0f : 0.0f; });
  PassAllOfNew();
  EXPECT_EQ(counts_.tiles, 1u);
}

}  // namespace
}  // namespace palpate
