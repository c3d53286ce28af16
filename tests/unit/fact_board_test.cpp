// The newest of each fact, with followers that are fast, slow and gone.
#include "server/services/fact_board.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <stdexcept>
#include <thread>

#include "tests/support/patience.h"

namespace palpate {
namespace {

using test::Eventually;

class Follower final : public FactFollower {
 public:
  explicit Follower(const FactBoard& board) : board_(board) {}
  void OnFacts() override { ++told_; }
  void End() override { is_ended_ = true; }

  // What is newer than at the last call.
  std::optional<v1::Facts> Take() {
    v1::Facts facts;
    return board_.Take(taken_, facts) ? std::optional(facts) : std::nullopt;
  }
  int told() const { return told_; }
  bool is_ended() const { return is_ended_; }

 private:
  const FactBoard& board_;
  FactBoard::Told taken_{};
  std::atomic<int> told_{0};
  std::atomic<bool> is_ended_{false};
};

class FactBoardTest : public ::testing::Test {
 protected:
  std::shared_ptr<Follower> Follow() {
    auto follower = std::make_shared<Follower>(board_);
    board_.Add(follower);
    return follower;
  }
  // Settings are told at this revision; returns false if they never are.
  bool Told(Follower& follower, std::uint64_t revision) {
    return Eventually([&] {
      const auto facts = follower.Take();
      return facts && facts->has_settings() && facts->settings().settings_revision() == revision;
    });
  }
  void Set(std::uint64_t revision) {
    revision_ = revision;
    board_.MayHaveChanged("settings");
  }

  std::atomic<std::uint64_t> revision_{1};
  std::atomic<int> looks_{0}, failures_{0};
  std::atomic<bool> fails_{false};
  FactBoard board_{{{[this](v1::Facts& facts) {
                       ++looks_;
                       facts.mutable_settings()->set_settings_revision(revision_);
                       if (!fails_) return;
                       ++failures_;
                       throw std::runtime_error("no memory");
                     },
                     std::chrono::milliseconds(1),
                     {"settings"}},
                    {[](v1::Facts&) {}},
                    {[](v1::Facts&) {}},
                    {[](v1::Facts&) {}},
                    {[](v1::Facts&) {}},
                    {[](v1::Facts&) {}},
                    {[](v1::Facts&) {}},
                    {[](v1::Facts& facts) { facts.mutable_recording()->set_path("a"); }}}};
};

TEST_F(FactBoardTest, TellsAllAtFirstThenWhatHasChanged) {
  const auto follower = Follow();
  ASSERT_TRUE(Eventually([&] { return follower->told() > 0; }));
  const auto first = follower->Take();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->settings().settings_revision(), 1U);
  EXPECT_EQ(first->recording().path(), "a");
  EXPECT_FALSE(first->has_volume());
  EXPECT_FALSE(follower->Take());
  Set(2);
  std::optional<v1::Facts> second;
  ASSERT_TRUE(Eventually([&] { return (second = follower->Take()).has_value(); }));
  EXPECT_EQ(second->settings().settings_revision(), 2U);
  EXPECT_FALSE(second->has_recording());
}

TEST_F(FactBoardTest, WhoIsSlowGetsTheNewestAndDelaysNobody) {
  const auto slow = Follow();
  const auto fast = Follow();
  for (const std::uint64_t revision : {2, 3, 4}) {
    Set(revision);
    ASSERT_TRUE(Told(*fast, revision));
  }
  EXPECT_EQ(slow->Take()->settings().settings_revision(), 4U);
  EXPECT_FALSE(slow->Take());
}

TEST_F(FactBoardTest, WhoComesLaterGetsAllOfNow) {
  {
    const auto first = Follow();
    ASSERT_TRUE(Told(*first, 1));
  }
  revision_ = 7;  // nobody says so, nobody follows
  const auto later = Follow();
  v1::Facts all;
  EXPECT_TRUE(Eventually([&] {
    if (const auto facts = later->Take()) all.MergeFrom(*facts);
    return all.settings().settings_revision() == 7U && all.recording().path() == "a";
  }));
}

TEST_F(FactBoardTest, WhatChangesByItselfIsToldToo) {
  const auto follower = Follow();
  ASSERT_TRUE(Told(*follower, 1));
  revision_ = 2;
  EXPECT_TRUE(Told(*follower, 2));
}

// Who tells of a change may be a step ahead of it.
TEST_F(FactBoardTest, AChangeIsLookedForOnceMore) {
  const auto follower = Follow();
  ASSERT_TRUE(Told(*follower, 1));
  const int before = looks_;
  board_.MayHaveChanged("settings");
  EXPECT_TRUE(Eventually([&] { return looks_ >= before + 2; }));
}

TEST_F(FactBoardTest, NobodyLooksWhileNobodyFollows) {
  Set(2);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(looks_, 0);
}

TEST_F(FactBoardTest, AFactThatCannotBeSeenStaysAsItWas) {
  const auto follower = Follow();
  ASSERT_TRUE(Told(*follower, 1));
  fails_ = true;
  Set(2);
  ASSERT_TRUE(Eventually([&] { return failures_ > 0; }));
  EXPECT_FALSE(follower->Take());
  revision_ = 3;
  fails_ = false;
  EXPECT_TRUE(Told(*follower, 3));
}

TEST_F(FactBoardTest, StopEndsThoseWhoFollowAndThoseWhoComeLater) {
  const auto follower = Follow();
  board_.Stop();
  EXPECT_TRUE(follower->is_ended());
  EXPECT_TRUE(Follow()->is_ended());
}

}  // namespace
}  // namespace palpate
