// Volumes: what they may take of the memory, how they change, who frees them, and warnings.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/live_volume/memory_budget.h"
#include "server/live_volume/volume_loader.h"
#include "server/live_volume/volume_store.h"
#include "server/volume/snapshot/brick_memory.h"
#include "server/volume/snapshot/leaf.h"
#include "tests/support/made_volume.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using Leaves = std::vector<LeafPtr>;
using Lines = std::vector<std::string>;
using std::chrono::milliseconds;
using testing::Refusal;

TEST(LoadWarnings, TheSourceInFrontIsLeftOut) {
  const Lines warnings = {"/tmp/a.nrrd: no spacing", "no spacing of /tmp/a.nrrd: 1 mm"};
  EXPECT_EQ(WarningsForClients(warnings, "/tmp/a.nrrd"),
            Lines({"no spacing", "no spacing of /tmp/a.nrrd: 1 mm"}));
}

TEST(LoadWarnings, AreFewAndTheRestIsCounted) {
  EXPECT_TRUE(WarningsForClients({}, "a").empty());
  EXPECT_EQ(WarningsForClients(Lines(16, "x"), "a"), Lines(16, "x"));
  Lines expected(15, "x");
  expected.push_back("and 3 more");
  EXPECT_EQ(WarningsForClients(Lines(18, "x"), "a"), expected);
}

TEST(LoadWarnings, AreShortAndWholeCharacters) {
  const Lines warnings = {std::string(1000, 'x'), "y" + std::string(1000, '\n')};
  EXPECT_EQ(WarningsForClients(warnings, "a"),
            Lines({std::string(300, 'x'), "y" + std::string(299, ' ')}));
  std::string wide = "xx";
  for (int k = 0; k < 500; ++k) wide += "\u00e4";
  EXPECT_EQ(WarningsForClients(Lines{wide}, "a"), Lines{wide.substr(0, 300)});
  EXPECT_EQ(WarningsForClients(Lines{"x" + wide}, "a"), Lines{("x" + wide).substr(0, 299)});
}

TEST(LoadWarnings, AreUtf8WhateverAFileHolds) {
  const Lines good = {"\u00e4 \u20ac \U0001f600 \ud7ff \ue000 \U0010ffff"};
  EXPECT_EQ(WarningsForClients(good, "a"), good);
  const Lines bad = {"\xff",         "\xc0\x80",         "\xe0\x80\x80",
                     "\xed\xa0\x80", "\xf4\x90\x80\x80", "\xe2\x82"};
  const Lines expected = {"?", "??", "???", "???", "????", "??"};
  EXPECT_EQ(WarningsForClients(bad, "a"), expected);
}

constexpr std::uint64_t kMib = 1 << 20;

void ExpectRefused(const std::function<void()>& call) {
  EXPECT_EQ(testing::Refusal(call), ErrorKind::kTooLarge);
}

// The refusal names these.
void ExpectNamed(const std::function<void()>& call, const std::vector<std::string>& names) {
  ExpectRefused(call);
  const std::string text = testing::Complaint(call);
  for (const std::string& name : names) EXPECT_NE(text.find(name), std::string::npos) << text;
}

TEST(MemoryBudget, IsFullAndEmptyToTheByte) {
  const auto budget = MemoryBudget::Make(100);
  {
    const MemoryClaim most = budget->Claim("a", 99);
    ExpectRefused([&] { budget->Claim("b", 2); });
    const MemoryClaim rest = budget->Claim("b", 1);
    EXPECT_EQ(budget->held_bytes(), 100u);
    ExpectRefused([&] { budget->Claim("c", 1); });
    EXPECT_EQ(budget->Claim("c", 0).bytes(), 0u);
  }
  EXPECT_EQ(budget->held_bytes(), 0u);
  EXPECT_EQ(budget->Claim("c", 100).bytes(), 100u);
  ExpectRefused([&] { budget->Claim("c", 101); });
}

TEST(MemoryBudget, HugeClaimsDoNotWrap) {
  const auto budget = MemoryBudget::Make(100);
  const MemoryClaim claim = budget->Claim("a", 50);
  ExpectRefused([&] { budget->Claim("b", MemoryBudget::kUnlimited); });
  ExpectRefused([&] { budget->Claim("b", MemoryBudget::kUnlimited - 49); });
  ExpectRefused([&] { budget->Claim("b", MemoryBudget::kUnlimited - 50); });
  EXPECT_EQ(budget->held_bytes(), 50u);
  const auto unlimited = MemoryBudget::Make();
  const MemoryClaim all = unlimited->Claim("a", MemoryBudget::kUnlimited);
  ExpectRefused([&] { unlimited->Claim("b", 1); });
}

TEST(MemoryBudget, SaysWhatIsNeededAndHeld) {
  const auto budget = MemoryBudget::Make(100 * kMib);
  const MemoryClaim volume = budget->Claim("the volume", 60 * kMib);
  const MemoryClaim upload = budget->Claim("an upload", kMib + 1);
  ExpectNamed([&] { budget->Claim("the new volume", 50 * kMib - 1); },
              {"the new volume needs 50 MiB", "100 MiB", "62 MiB", "an upload 2 MiB",
               "the volume 60 MiB", "volume.memory_budget_mib"});
}

TEST(MemoryBudget, AClaimGrowsShrinksAndMoves) {
  const auto budget = MemoryBudget::Make(100);
  MemoryClaim claim = budget->Claim("a", 40);
  const MemoryClaim other = budget->Claim("b", 40);
  claim.Resize(60);
  ExpectRefused([&] { claim.Resize(61); });
  EXPECT_EQ(claim.bytes(), 60u);
  EXPECT_EQ(budget->held_bytes(), 100u);
  claim.Resize(10);
  MemoryClaim moved = std::move(claim);
  EXPECT_EQ(budget->held_bytes(), 50u);
  moved.Resize(20);
  EXPECT_EQ(budget->held_bytes(), 60u);
  moved = MemoryClaim();
  EXPECT_EQ(budget->held_bytes(), 40u);
  moved = budget->Claim("c", 55);
  EXPECT_EQ(budget->held_bytes(), 95u);
}

TEST(MemoryBudget, AClaimOutlivesTheOthersHandle) {
  auto budget = MemoryBudget::Make(10);
  MemoryClaim claim = budget->Claim("a", 5);
  budget.reset();
  claim.Resize(10);
  ExpectRefused([&] { claim.Resize(11); });
}

TEST(MemoryBudget, ThreadsNeverHoldMoreThanThereIs) {
  const auto budget = MemoryBudget::Make(10);
  std::atomic<int> refused = 0;
  std::atomic<int> too_much = 0;
  test::OnThreads(4, [&](int) {
    for (int round = 0; round < 2000; ++round) {
      try {
        MemoryClaim claim = budget->Claim("a", 4);
        too_much += budget->held_bytes() > 10;
        claim.Resize(5);
      } catch (const Error&) {
        ++refused;
      }
    }
  });
  EXPECT_EQ(too_much, 0);
  EXPECT_EQ(budget->held_bytes(), 0u);
}

std::atomic<std::uint64_t> live{0};
std::uint64_t Live() noexcept { return live; }

TEST(MemoryBudget, WhatLivesCountsBesideTheClaims) {
  live = 60;
  const auto budget = MemoryBudget::Make(100, Live);
  EXPECT_EQ(budget->held_bytes(), 60u);
  EXPECT_EQ(budget->left_bytes(), 40u);
  MemoryClaim claim = budget->Claim("a", 40);
  ExpectRefused([&] { budget->Claim("b", 1); });
  // It is made, and the claim shrinks.
  live = 90;
  claim.Resize(10);
  EXPECT_EQ(budget->held_bytes(), 100u);
  // More lives than anybody claimed: nothing may grow, and all may shrink.
  live = 200;
  EXPECT_EQ(budget->left_bytes(), 0u);
  ExpectRefused([&] { claim.Resize(11); });
  claim.Resize(0);
  live = 0;
  EXPECT_EQ(budget->left_bytes(), 100u);
}

TEST(MemoryBudget, SaysWhatLives) {
  live = 62 * kMib;
  const auto budget = MemoryBudget::Make(100 * kMib, Live);
  budget->SetPart("the volume", 40 * kMib);
  budget->SetPart("edits to undo", 20 * kMib);
  const MemoryClaim claim = budget->Claim("the filter", 8 * kMib);
  const auto claim_more = [&] { budget->Claim("the edit", 31 * kMib); };
  ExpectNamed(claim_more, {"31 MiB", "100 MiB", "70 MiB", "edits to undo 20 MiB",
                           "other bricks 2 MiB", "the filter 8 MiB", "the volume 40 MiB"});
  // A part may share bricks with another.
  budget->SetPart("edits to undo", 0);
  budget->SetPart("the volume", 70 * kMib);
  ExpectNamed(claim_more, {"(the filter 8 MiB, the volume 70 MiB)"});
}

TEST(MemoryBudget, WaitsForWhatIsBeingFreed) {
  live = 90;
  const auto budget = MemoryBudget::Make(100, Live);
  int waits = 0;
  budget->SetWait([&](std::chrono::milliseconds) {
    ++waits;
    if (waits == 2) live = 0;
  });
  EXPECT_EQ(budget->Claim("a", 10).bytes(), 10u);
  EXPECT_EQ(waits, 0);
  ExpectRefused([&] { budget->Claim("a", 50); });
  EXPECT_EQ(budget->Claim("a", 50).bytes(), 50u);
  EXPECT_EQ(waits, 2);
  budget->SetWait({});
  ExpectRefused([&] { budget->Claim("a", 101); });
}

TEST(MemoryBudget, KnowsTheLeastLimitOfItsControlGroups) {
  const test::TemporaryFolder folder;
  const auto write = [&](const char* path, const char* text) {
    std::filesystem::create_directories((folder.path() / path).parent_path());
    std::ofstream(folder.path() / path) << text;
  };
  const auto limit = [&](const char* own) {
    std::istringstream lines(own);
    return CgroupLimitBytes(folder.path(), lines);
  };
  constexpr auto kNone = std::numeric_limits<std::uint64_t>::max();
  write("memory.max", "max\n");
  write("system.slice/memory.max", "300000000\n");
  write("system.slice/palpated.service/memory.max", "max\n");
  write("memory/memory.limit_in_bytes", "9223372036854771712\n");
  write("memory/lab/memory.limit_in_bytes", "200000000\n");
  EXPECT_EQ(limit("0::/system.slice/palpated.service\n"), 300000000u);
  EXPECT_EQ(limit("0::/\n"), kNone);
  EXPECT_EQ(limit("0::/not/there\n"), kNone);  // in a container
  EXPECT_EQ(limit("12:cpu,cpuacct:/lab\n9:memory:/lab/cell\n0::/\n"), 200000000u);
  EXPECT_EQ(limit("3:cpu:/lab\nrubbish\n"), kNone);
}

TEST(MemoryBudget, TheDefaultIsLessThanTheMachineHas) {
  EXPECT_GT(DefaultMemoryBudget(), 64 * kMib);
  EXPECT_LT(DefaultMemoryBudget(), std::uint64_t{1} << 50);
}

class VolumeStoreTest : public ::testing::Test {
 protected:
  void Load() { store_.Replace(metadata_, bricks_, 0, false, publish_); }
  static std::vector<BrickChange> Paint(const VolumeSnapshot& present) {
    return testing::PaintedBox(present.bricks(), Vec3i::Zero(), Vec3i(1, 1, 1),
                               [] { return 0.5f; });
  }

  const VolumeMetadata metadata_ = [] {
    VolumeMetadata metadata;
    metadata.size = Vec3i(16, 8, 8);
    return metadata;
  }();
  const BrickDirectory bricks_ =
      testing::MakeBricks(metadata_.size, [](int, int, int) { return 0.25f; });
  std::vector<std::shared_ptr<const VolumeSnapshot>> published_;  // without a lock of its own
  const VolumeStore::Publish publish_ = [this](const auto& volume, const auto&) {
    if (published_.empty() || published_.back() != volume) published_.push_back(volume);
    return 10 * published_.size();
  };
  VolumeStore store_{MemoryBudget::Make(), [] {}, publish_};
};

TEST_F(VolumeStoreTest, BeforeTheFirstVolumeThereIsNothingToEdit) {
  const auto edit = [&] { store_.Edit([](const auto& present) { return Paint(*present); }); };
  EXPECT_EQ(Refusal(edit), ErrorKind::kUnavailable);
  Load();
  EXPECT_FALSE(Refusal(edit));
}

TEST_F(VolumeStoreTest, AnEditIsPublishedAndNoneIsNot) {
  Load();
  const EditedRevisions none = store_.Edit([](const auto&) { return std::vector<BrickChange>(); });
  EXPECT_EQ(none.volume, 1u);
  EXPECT_EQ(none.scene, 10u);
  const EditedRevisions edited = store_.Edit([](const auto& present) { return Paint(*present); });
  EXPECT_EQ(edited.volume, 2u);
  EXPECT_EQ(edited.scene, 20u);
  EXPECT_EQ(published_.at(1)->revision(), 2u);
  EXPECT_EQ(published_.at(1)->loaded_revision(), 1u);
  EXPECT_EQ(published_.at(1)->bricks().At(Vec3i::Zero())->Floats()[0], 0.5f);
  Load();
  EXPECT_EQ(published_.at(2)->loaded_revision(), 3u);
}

TEST_F(VolumeStoreTest, WhatIsRefusedChangesNothing) {
  Load();
  EXPECT_THROW(store_.Edit([](const auto&) -> std::vector<BrickChange> {
    throw std::runtime_error("no edit");
  }),
               std::runtime_error);
  EXPECT_THROW(store_.Replace(metadata_, bricks_, 0, false,
                              [](const auto&, const auto&) -> std::uint64_t {
                                throw std::runtime_error("no volume");
                              }),
               std::runtime_error);
  EXPECT_EQ(store_.Edit([](const auto& present) { return Paint(*present); }).volume, 2u);
}

TEST_F(VolumeStoreTest, OneTransactionAtATime) {
  Load();
  constexpr int kThreads = 4, kEdits = 200;
  test::OnThreads(kThreads, [&](int) {
    for (int k = 0; k < kEdits; ++k) {
      store_.Edit([](const auto& present) { return Paint(*present); });
    }
  });
  ASSERT_EQ(published_.size(), 1u + kThreads * kEdits);
  for (std::size_t n = 0; n < published_.size(); ++n) EXPECT_EQ(published_[n]->revision(), n + 1);
}

TEST_F(VolumeStoreTest, AnEditDoesNotFreeTheVolumeThatItReplaces) {
  std::atomic<bool> may_free = false;
  std::vector<std::weak_ptr<const VolumeSnapshot>> seen;
  const VolumeStore::Publish publish = [&](const auto& volume, const auto&) {
    seen.emplace_back(volume);
    return seen.size();
  };
  VolumeStore store(
      MemoryBudget::Make(), [&] { may_free.wait(false); }, publish);
  store.Replace(metadata_, bricks_, 0, false, publish);
  store.Edit([](const auto& present) { return Paint(*present); });
  EXPECT_FALSE(seen.at(0).expired());
  may_free = true;
  may_free.notify_all();
  EXPECT_TRUE(test::Eventually([&] { return seen[0].expired(); }));
}

constexpr milliseconds kLong{60'000};

// Says which thread freed it.
struct Tracked {
  explicit Tracked(std::atomic<std::thread::id>& by) : freed_by(by) {}
  ~Tracked() { freed_by = std::this_thread::get_id(); }
  std::atomic<std::thread::id>& freed_by;
};

std::shared_ptr<const Leaves> MakeLeaves(int count) {
  Leaves leaves;
  for (int n = 0; n < count; ++n) leaves.push_back(Leaf::Of(LeafType::kFloat, Brick{}));
  return std::make_shared<const Leaves>(std::move(leaves));
}

TEST(RetiredVolumes, OneThreadFreesWhatNobodyElseHolds) {
  std::atomic<std::thread::id> freed_by{};
  std::atomic<int> collected = 0;
  RetiredVolumes retired([&] { ++collected; });
  auto held = std::make_shared<const Tracked>(freed_by);
  retired.Add(held);
  // Also while nobody adds anything.
  EXPECT_TRUE(test::Eventually([&] { return collected >= 2; }));
  EXPECT_EQ(freed_by.load(), std::thread::id());
  held.reset();
  EXPECT_EQ(freed_by.load(), std::thread::id());
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
  EXPECT_NE(freed_by.load(), std::this_thread::get_id());
  retired.Add(nullptr);
  retired.WaitForFreed(kLong);
}

TEST(RetiredVolumes, NobodyWaitsLongForWhatOthersKeep) {
  RetiredVolumes retired([] {});
  const auto kept = MakeLeaves(10);
  retired.Add(kept);
  retired.WaitForFreed(std::chrono::hours(1));
  // What others let go is freed though.
  std::atomic<std::thread::id> freed_by{};
  retired.Add(std::make_shared<const Tracked>(freed_by));
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
}

TEST(RetiredVolumes, WhatIsHandedOverTwiceIsFreedToo) {
  std::atomic<std::thread::id> freed_by{};
  RetiredVolumes retired([] {});
  auto held = std::make_shared<const Tracked>(freed_by);
  retired.Add(held);
  retired.Add(held);
  retired.WaitForFreed(milliseconds(20));
  retired.Add(std::move(held));
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
}

TEST(RetiredVolumes, WhatTheServoLeavesIsFreedToo) {
  std::atomic<std::thread::id> freed_by{};
  std::shared_ptr<const Tracked> with_servo = std::make_shared<const Tracked>(freed_by);
  std::atomic<bool> servo_left = false;
  RetiredVolumes retired([&] {
    if (servo_left) with_servo.reset();
  });
  retired.Add(with_servo);
  retired.WaitForFreed(milliseconds(20));
  servo_left = true;
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
}

// A leaf's own counter falls when it is freed, and its memory goes back a little later.
TEST(RetiredVolumes, BricksCountUntilTheThreadHasFreedAllOfThem) {
  struct Watched {
    ~Watched() {
      leaves.reset();
      live_in_the_midst = LiveBrickBytes();
    }
    std::shared_ptr<const Leaves> leaves;
    std::atomic<std::uint64_t>& live_in_the_midst;
  };
  const std::uint64_t before = LiveBrickBytes();
  std::atomic<std::uint64_t> live_in_the_midst = 0;
  RetiredVolumes retired([] {});
  // Made here: clang 14 makes no aggregates in place.
  retired.Add(std::shared_ptr<const Watched>(new Watched{MakeLeaves(100), live_in_the_midst}));
  retired.WaitForFreed(kLong);
  EXPECT_EQ(live_in_the_midst, before + 100 * Leaf::Bytes(LeafType::kFloat));
  EXPECT_EQ(LiveBrickBytes(), before);
}

TEST(RetiredVolumes, TheEndFreesWhatIsLeft) {
  std::atomic<std::thread::id> freed_by{};
  auto held = std::make_shared<const Tracked>(freed_by);
  const std::weak_ptr<const Tracked> seen = held;
  {
    RetiredVolumes retired([] {});
    retired.Add(held);
    held.reset();
  }
  EXPECT_TRUE(seen.expired());
}

TEST(RetiredVolumes, ManyThreadsHandOver) {
  const std::uint64_t before = LiveBrickBytes();
  RetiredVolumes retired([] {});
  test::OnThreads(4, [&](int) {
    std::shared_ptr<const Leaves> shown = MakeLeaves(3);
    for (int round = 0; round < 200; ++round) {
      retired.Add(std::exchange(shown, MakeLeaves(3)));
      if (round % 50 == 0) retired.WaitForFreed(milliseconds(5));
    }
  });
  retired.WaitForFreed(kLong);
  EXPECT_EQ(LiveBrickBytes(), before);
}

TEST(BrickWork, CountsWhatItsThreadMakesAndFrees) {
  const BrickWork work;
  auto leaves = MakeLeaves(100);
  const std::uint64_t made = 100 * Leaf::Bytes(LeafType::kFloat);
  EXPECT_EQ(work.made_bytes(), made);
  std::thread([] { MakeLeaves(7); }).join();
  leaves.reset();
  EXPECT_EQ(work.made_bytes(), 0u);
  EXPECT_EQ(work.most_bytes(), made);
}

}  // namespace
}  // namespace palpate
