#include "server/security/connection_limits.h"

#include <algorithm>
#include <map>
#include <numeric>

namespace palpate {
namespace {

// With TLS, 177 B were measured for a whole call that sets an isovalue, 89 B for each sample
// of a stream at 1 kHz (its windows and credits), a 1700th of what is downloaded, and a 700th
// around what is uploaded. With room: whoever uses that up on purpose fills some MB a second.
constexpr std::int64_t kBytesOfCall = 512;
constexpr std::int64_t kBytesAroundMessage = 96;
constexpr std::int64_t kShareAroundMessage = 64;
constexpr std::int64_t kBytesBackOfAnswer = 96;
constexpr std::int64_t kShareBack = 256;
// What was under way when calls were refused or cancelled is forgiven in hours.
constexpr std::int64_t kBytesOfSecond = 4096;

using Indexes = std::vector<std::size_t>;

// The one that sent most goes first, until the rest has sent little enough.
void CutForBytes(std::span<const BoundedConnection> connections, const ConnectionBounds& bounds,
                 Indexes& left, std::vector<ConnectionCut>& cuts) {
  std::stable_sort(left.begin(), left.end(), [&](std::size_t a, std::size_t b) {
    return connections[a].bytes < connections[b].bytes;
  });
  std::int64_t sum = std::accumulate(
      left.begin(), left.end(), std::int64_t{0},
      [&](std::int64_t so_far, std::size_t n) { return so_far + connections[n].bytes; });
  while (!left.empty()) {
    const std::int64_t most = connections[left.back()].bytes;
    if (most <= bounds.bytes_of_one && sum <= bounds.bytes_of_all) break;
    cuts.push_back({left.back(), true});
    sum -= most;
    left.pop_back();
  }
}

// The oldest of the address that has most.
void CutForNumber(std::span<const BoundedConnection> connections, const ConnectionBounds& bounds,
                  Indexes& left, std::vector<ConnectionCut>& cuts) {
  if (left.size() <= bounds.connections) return;
  std::map<std::string_view, Indexes> by_address;
  std::sort(left.begin(), left.end());
  for (const std::size_t n : left) by_address[connections[n].address].push_back(n);
  for (std::size_t count = left.size(); count > bounds.connections; --count) {
    auto& most = std::max_element(by_address.begin(), by_address.end(), [](auto& a, auto& b) {
                   return a.second.size() < b.second.size();
                 })->second;
    cuts.push_back({most.front(), false});
    most.erase(most.begin());
  }
}

}  // namespace

std::vector<ConnectionCut> CutsAmong(std::span<const BoundedConnection> connections,
                                     const ConnectionBounds& bounds) {
  Indexes left(connections.size());
  std::iota(left.begin(), left.end(), std::size_t{0});
  std::vector<ConnectionCut> cuts;
  CutForBytes(connections, bounds, left, cuts);
  CutForNumber(connections, bounds, left, cuts);
  return cuts;
}

std::int64_t UnreadBytes::Update(std::int64_t received, std::int64_t acknowledged,
                                 const ReadBytes& read, std::int64_t now_ns) {
  if (first_ns_ == 0) first_ns_ = now_ns;
  const std::int64_t may_be = read.calls * kBytesOfCall + read.messages * kBytesAroundMessage +
                              read.message_bytes + read.message_bytes / kShareAroundMessage +
                              read.answers * kBytesBackOfAnswer + acknowledged / kShareBack +
                              (now_ns - first_ns_) / 1'000'000'000 * kBytesOfSecond;
  const std::int64_t balance = received - may_be;
  unread_ = std::max<std::int64_t>(0, unread_ + balance - balance_);
  balance_ = balance;
  return unread_;
}

}  // namespace palpate
