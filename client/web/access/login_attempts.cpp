#include "client/web/access/login_attempts.h"

namespace palpate::web {

bool LoginAttempts::MayTry(std::string_view address, Time now) {
  BeginAnew(now);
  const auto found = failed_.find(address);
  if (found == failed_.end()) return failed_.size() < kMostAddresses;
  return found->second < kMostAMinute;
}

void LoginAttempts::Failed(std::string_view address, Time now) {
  BeginAnew(now);
  ++failed_[std::string(address)];
}

void LoginAttempts::BeginAnew(Time now) {
  if (now - begin_ < std::chrono::minutes(1)) return;
  begin_ = now;
  failed_.clear();
}

}  // namespace palpate::web
