// What volumes may take of the memory.
#include "server/store/memory_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

constexpr std::uint64_t kMib = 1 << 20;

void ExpectRefused(const std::function<void()>& call) {
  EXPECT_EQ(testing::Refusal(call), ErrorKind::kTooLarge);
}

// The refusal names these.
void ExpectNamed(const std::function<void()>& call, const std::vector<std::string>& names) {
  try {
    call();
    ADD_FAILURE() << "accepted";
  } catch (const Error& error) {
    const std::string text = error.what();
    EXPECT_EQ(error.kind(), ErrorKind::kTooLarge);
    for (const std::string& name : names) EXPECT_NE(text.find(name), std::string::npos) << text;
  }
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
  std::vector<std::thread> threads;
  for (int n = 0; n < 4; ++n) {
    threads.emplace_back([&] {
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
  }
  for (std::thread& thread : threads) thread.join();
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

TEST(MemoryBudget, TheDefaultIsLessThanTheMachineHas) {
  EXPECT_GT(DefaultMemoryBudget(), 64 * kMib);
  EXPECT_LT(DefaultMemoryBudget(), std::uint64_t{1} << 50);
}

}  // namespace
}  // namespace palpate
