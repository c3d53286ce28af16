// Decides which lines about clients are logged: no flood may fill the log, nor hide lines about
// other known clients.
//
// Each address or identity gets twenty lines at once and then one every ten seconds. Each line says
// how many were left out. Above kMostClients, the further ones share one budget.
// Threads: any.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "server/log/rate_limit.h"

namespace palpate {

class LineBudget {
 public:
  static constexpr std::size_t kMostClients = 256;

  // `whose`: an identity, or a peer as gRPC names it ("ipv4:10.0.0.7:51312"), whose port makes no
  // difference. Returns how many lines were left out since the last one; none if this line is left
  // out, too.
  std::optional<std::uint64_t> Take(const std::string& whose, std::int64_t now_ns);

 private:
  struct Budget {
    RateLimit lines{0.1, 20.0};
    std::uint64_t left_out = 0;
    std::int64_t last_ns = 0;
  };

  std::mutex mutex_;
  std::map<std::string, Budget> budgets_;
};

// The address without the port, which changes with each connection.
std::string AddressOf(const std::string& peer);

}  // namespace palpate
