#include "server/log/line_budget.h"

#include <utility>

namespace palpate {
namespace {

constexpr std::int64_t kForgottenAfterNs = 60'000'000'000;

}  // namespace

std::string AddressOf(const std::string& peer) {
  if (!peer.starts_with("ipv4:") && !peer.starts_with("ipv6:")) return peer;
  return peer.substr(0, peer.rfind(':'));
}

std::optional<std::uint64_t> LineBudget::Take(const std::string& whose, std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  const std::string key = AddressOf(whose);
  const bool is_new = budgets_.find(key) == budgets_.end();
  if (is_new && budgets_.size() >= kMostClients) {
    std::erase_if(budgets_, [&](const auto& entry) {
      return entry.second.left_out == 0 && now_ns - entry.second.last_ns > kForgottenAfterNs;
    });
  }
  Budget& budget = budgets_[is_new && budgets_.size() >= kMostClients ? "others" : key];
  budget.last_ns = now_ns;
  if (!budget.lines.Take(now_ns)) {
    ++budget.left_out;
    return std::nullopt;
  }
  return std::exchange(budget.left_out, 0);
}

}  // namespace palpate
