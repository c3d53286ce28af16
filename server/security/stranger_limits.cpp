#include "server/security/stranger_limits.h"

#include <algorithm>
#include <map>
#include <numeric>

namespace palpate {
namespace {

using Indexes = std::vector<std::size_t>;

// The one that sent most goes first, until the rest has sent little enough.
void CutForBytes(std::span<const StrangerConnection> strangers, Indexes& left,
                 std::vector<StrangerCut>& cuts) {
  std::stable_sort(left.begin(), left.end(), [&](std::size_t a, std::size_t b) {
    return strangers[a].received_bytes < strangers[b].received_bytes;
  });
  std::int64_t sum = std::accumulate(
      left.begin(), left.end(), std::int64_t{0},
      [&](std::int64_t so_far, std::size_t n) { return so_far + strangers[n].received_bytes; });
  while (!left.empty()) {
    const std::int64_t most = strangers[left.back()].received_bytes;
    if (most <= kMostBytesOfStranger && sum <= kMostBytesOfStrangers) break;
    cuts.push_back({left.back(), true});
    sum -= most;
    left.pop_back();
  }
}

// The oldest of the address that has most.
void CutForNumber(std::span<const StrangerConnection> strangers, Indexes& left,
                  std::vector<StrangerCut>& cuts) {
  std::map<std::string_view, Indexes> by_address;
  std::sort(left.begin(), left.end());
  for (const std::size_t n : left) by_address[strangers[n].address].push_back(n);
  for (std::size_t count = left.size(); count > kMostStrangers; --count) {
    auto& most = std::max_element(by_address.begin(), by_address.end(), [](auto& a, auto& b) {
                   return a.second.size() < b.second.size();
                 })->second;
    cuts.push_back({most.front(), false});
    most.erase(most.begin());
  }
}

}  // namespace

std::vector<StrangerCut> CutsAmongStrangers(std::span<const StrangerConnection> strangers) {
  Indexes left(strangers.size());
  std::iota(left.begin(), left.end(), std::size_t{0});
  std::vector<StrangerCut> cuts;
  CutForBytes(strangers, left, cuts);
  CutForNumber(strangers, left, cuts);
  return cuts;
}

}  // namespace palpate
