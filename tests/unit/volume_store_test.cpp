// The transactions in which a volume changes.
#include "server/store/volume_store.h"

#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

class VolumeStoreTest : public ::testing::Test {
 protected:
  void Load() { store_.Replace(metadata_, bricks_, 0, publish_); }
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
  EXPECT_THROW(store_.Replace(metadata_, bricks_, 0,
                              [](const auto&, const auto&) -> std::uint64_t {
                                throw std::runtime_error("no volume");
                              }),
               std::runtime_error);
  EXPECT_EQ(store_.Edit([](const auto& present) { return Paint(*present); }).volume, 2u);
}

TEST_F(VolumeStoreTest, OneTransactionAtATime) {
  Load();
  constexpr int kThreads = 4, kEdits = 200;
  std::vector<std::thread> threads;
  for (int n = 0; n < kThreads; ++n) {
    threads.emplace_back([&] {
      for (int k = 0; k < kEdits; ++k) {
        const VolumeStore::Hold hold(store_);
        store_.Edit([](const auto& present) { return Paint(*present); });
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  ASSERT_EQ(published_.size(), 1u + kThreads * kEdits);
  for (std::size_t n = 0; n < published_.size(); ++n) EXPECT_EQ(published_[n]->revision(), n + 1);
}

}  // namespace
}  // namespace palpate
