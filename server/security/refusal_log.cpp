#include "server/security/refusal_log.h"

#include <utility>

namespace palpate {
namespace {

constexpr std::int64_t kForgottenAfterNs = 60'000'000'000;

}  // namespace

std::string LeftOutInWords(std::uint64_t lines) {
  return lines == 0 ? "" : " (and " + std::to_string(lines) + " more since)";
}

std::string AddressOf(const std::string& peer) {
  if (!peer.starts_with("ipv4:") && !peer.starts_with("ipv6:")) return peer;
  return peer.substr(0, peer.rfind(':'));
}

std::optional<std::uint64_t> RefusalLog::Take(const std::string& peer, std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  const std::string address = AddressOf(peer);
  const bool is_new = budgets_.find(address) == budgets_.end();
  if (is_new && budgets_.size() >= kMostPeers) {
    std::erase_if(budgets_, [&](const auto& entry) {
      return entry.second.left_out == 0 && now_ns - entry.second.last_ns > kForgottenAfterNs;
    });
  }
  Budget& budget = budgets_[is_new && budgets_.size() >= kMostPeers ? "others" : address];
  budget.last_ns = now_ns;
  if (!budget.lines.Take(now_ns)) {
    ++budget.left_out;
    return std::nullopt;
  }
  return std::exchange(budget.left_out, 0);
}

}  // namespace palpate
