#include "client/web/logins/sessions.h"

#include <utility>

namespace palpate::web {
namespace {

constexpr int kSecretBits = 128;
// Longer cookies are no session's. They are not worth a hash.
constexpr std::size_t kSecretDigits = kSecretBits / 4;

}  // namespace

Sessions::Sessions(std::chrono::seconds life, std::size_t most) : life_(life), most_(most) {}

Sessions::Opened Sessions::Open(std::string user, std::vector<std::string> may_steer,
                                std::string network, Time now) {
  MakeRoom(now);
  Opened opened{NewSecret(kSecretBits), {}};
  auto session = std::make_shared<Session>();
  session->user = std::move(user);
  session->may_steer = std::move(may_steer);
  session->network = std::move(network);
  session->ends = now + life_;
  opened.session = session;
  kept_[Sha256(opened.secret)] = {std::move(session), now};
  return opened;
}

SessionPtr Sessions::Find(std::string_view secret, Time now) {
  if (secret.size() != kSecretDigits) return nullptr;
  const auto found = kept_.find(Sha256(secret));
  if (found == kept_.end()) return nullptr;
  if (found->second.session->IsOver(now)) {
    Forget(found);
    return nullptr;
  }
  found->second.used = now;
  return found->second.session;
}

void Sessions::Forget(std::string_view secret) {
  const auto found = kept_.find(Sha256(secret));
  if (found != kept_.end()) Forget(found);
}

void Sessions::Forget(Map::iterator kept) {
  kept->second.session->forgotten = true;
  kept_.erase(kept);
}

void Sessions::MakeRoom(Time now) {
  if (kept_.size() < most_) return;
  auto oldest = kept_.end();
  for (auto kept = kept_.begin(); kept != kept_.end();) {
    const auto here = kept++;
    if (here->second.session->IsOver(now)) {
      Forget(here);
    } else if (here->second.session.use_count() == 1 &&
               (oldest == kept_.end() || here->second.used < oldest->second.used)) {
      oldest = here;
    }
  }
  if (kept_.size() >= most_ && oldest != kept_.end()) Forget(oldest);
}

}  // namespace palpate::web
