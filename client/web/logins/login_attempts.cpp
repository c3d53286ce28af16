#include "client/web/logins/login_attempts.h"

namespace palpate::web {

bool LoginAttempts::IsFew(std::string_view address, Time now) {
  if (now - begin_ >= std::chrono::minutes(1)) {
    begin_ = now;
    failed_.clear();
  }
  auto found = failed_.find(address);
  if (found == failed_.end()) {
    if (failed_.size() >= kMostAddresses) return false;
    found = failed_.emplace(std::string(address), 0).first;
  }
  if (found->second >= kMostAMinute) return false;
  ++found->second;
  return true;
}

}  // namespace palpate::web
