// What volumes may take of the memory.
#include "server/session/memory_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr std::uint64_t kMib = 1 << 20;

std::string Refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kTooLarge);
    return error.what();
  }
  ADD_FAILURE() << "accepted";
  return "";
}

TEST(MemoryBudget, IsFullAndEmptyToTheByte) {
  const auto budget = MemoryBudget::Make(100);
  {
    const MemoryClaim most = budget->Claim("a", 99);
    Refusal([&] { budget->Claim("b", 2); });
    const MemoryClaim rest = budget->Claim("b", 1);
    EXPECT_EQ(budget->held_bytes(), 100u);
    Refusal([&] { budget->Claim("c", 1); });
    EXPECT_EQ(budget->Claim("c", 0).bytes(), 0u);
  }
  EXPECT_EQ(budget->held_bytes(), 0u);
  EXPECT_EQ(budget->Claim("c", 100).bytes(), 100u);
  Refusal([&] { budget->Claim("c", 101); });
}

TEST(MemoryBudget, HugeClaimsDoNotWrap) {
  const auto budget = MemoryBudget::Make(100);
  const MemoryClaim claim = budget->Claim("a", 50);
  Refusal([&] { budget->Claim("b", MemoryBudget::kUnlimited); });
  Refusal([&] { budget->Claim("b", MemoryBudget::kUnlimited - 49); });
  Refusal([&] { budget->Claim("b", MemoryBudget::kUnlimited - 50); });
  EXPECT_EQ(budget->held_bytes(), 50u);
  const auto unlimited = MemoryBudget::Make();
  const MemoryClaim all = unlimited->Claim("a", MemoryBudget::kUnlimited);
  Refusal([&] { unlimited->Claim("b", 1); });
}

TEST(MemoryBudget, SaysWhatIsNeededHeldAndLeftToDo) {
  const auto budget = MemoryBudget::Make(100 * kMib);
  const MemoryClaim volume = budget->Claim("the volume", 60 * kMib);
  const MemoryClaim upload = budget->Claim("an upload", kMib + 1);
  EXPECT_EQ(Refusal([&] { budget->Claim("the new volume", 50 * kMib - 1); }),
            "the new volume needs 50 MiB; of the memory budget of 100 MiB, 62 MiB are held (an "
            "upload 2 MiB, the volume 60 MiB): load something smaller first, crop the data, or "
            "raise volume.memory_budget_mib");
  EXPECT_NE(Refusal([&] { MemoryBudget::Make(1)->Claim("x", 2); }).find(", 0 MiB are held:"),
            std::string::npos);
}

TEST(MemoryBudget, AClaimGrowsShrinksAndMoves) {
  const auto budget = MemoryBudget::Make(100);
  MemoryClaim claim = budget->Claim("a", 40);
  const MemoryClaim other = budget->Claim("b", 40);
  claim.Resize(60);
  Refusal([&] { claim.Resize(61); });
  EXPECT_EQ(claim.bytes(), 60u);
  EXPECT_EQ(budget->held_bytes(), 100u);
  claim.Resize(10);
  MemoryClaim moved = std::move(claim);
  EXPECT_EQ(budget->held_bytes(), 50u);
  moved.Rename("b");
  moved.Rename("c");
  moved.Resize(20);
  EXPECT_EQ(budget->held_bytes(), 60u);
  moved = MemoryClaim();
  EXPECT_EQ(budget->held_bytes(), 40u);
  MemoryClaim().Rename("nobody");
}

TEST(MemoryBudget, AssigningGivesBackWhatWasHeld) {
  const auto budget = MemoryBudget::Make(100);
  MemoryClaim claim = budget->Claim("a", 90);
  claim = {};
  claim = budget->Claim("b", 95);
  EXPECT_EQ(budget->held_bytes(), 95u);
}

TEST(MemoryBudget, AClaimOutlivesTheOthersHandle) {
  auto budget = MemoryBudget::Make(10);
  MemoryClaim claim = budget->Claim("a", 5);
  budget.reset();
  claim.Resize(10);
  Refusal([&] { claim.Resize(11); });
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
          claim.Rename("b");
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

TEST(MemoryBudget, TheDefaultIsLessThanTheMachineHas) {
  EXPECT_GT(DefaultMemoryBudget(), 64 * kMib);
  EXPECT_LT(DefaultMemoryBudget(), std::uint64_t{1} << 50);
}

}  // namespace
}  // namespace palpate
