#include "client/web/logins/access.h"

#include <algorithm>
#include <cctype>
#include <optional>
#include <utility>

#include "common/error/error.h"

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

namespace {

bool IsName(std::string_view name) {
  const auto is_plain = [](unsigned char c) {
    return c < 128 && (std::isalnum(c) || c == '.' || c == '_' || c == '-');
  };
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), is_plain);
}

// Guests' names begin so.
constexpr std::string_view kGuest = "guest-";

Digest TokenOf(const User& user) {
  if (!IsName(user.name)) {
    Refuse("the name of a user has 1 to 64 letters, digits and ._- only");
  }
  const std::string who = "user " + user.name + ": ";
  if (user.name.starts_with(kGuest)) Refuse(who + "names of guests begin with guest-");
  for (const std::string& key : user.may_steer) {
    if (!IsSetting(key)) Refuse(who + "may_steer has an unknown setting");
  }
  const std::optional<Digest> token = DigestFromHex(user.token_sha256_hex);
  if (!token) Refuse(who + "token_sha256 has 64 hex digits: palpate-web user makes it");
  return *token;
}

}  // namespace

Access::Access(AccessOptions options) : sessions_(options.session_life) {
  if (!options.room_key.empty()) {
    if (options.room_key.size() < kMinRoomKeyLength) {
      Refuse("the room's key has fewer than 16 characters: it could be guessed");
    }
    has_room_ = true;
    room_key_ = Sha256(options.room_key);
  }
  for (User& user : options.users) {
    const Digest token = TokenOf(user);
    for (const Known& other : users_) {
      if (other.name == user.name) Refuse("user " + user.name + ": two users have this name");
      if (other.token == token) Refuse("user " + user.name + ": " + other.name + " has this token");
    }
    users_.push_back({token, std::move(user.name), std::move(user.may_steer)});
  }
}

Access::Login Access::LogIn(Secret kind, std::string_view secret, std::string_view network,
                            Time now) {
  const Digest digest = Sha256(secret);
  const Known* user = kind == Secret::kToken ? FindUser(digest) : nullptr;
  const bool is_guest = kind == Secret::kRoomKey && has_room_ && IsEqual(digest, room_key_);
  if (user == nullptr && !is_guest) {
    return {attempts_.IsFew(network, now) ? Result::kWrong : Result::kTooManyAttempts, {}, {}};
  }
  Sessions::Opened opened =
      user != nullptr ? sessions_.Open(user->name, user->may_steer, "user " + user->name, now)
                      : sessions_.Open(std::string(kGuest) + std::to_string(++guests_), {},
                                       std::string(network), now);
  return {Result::kWelcome, std::move(opened.secret), std::move(opened.session)};
}

// Compares with all tokens, so that the time does not tell which user's token was close.
const Access::Known* Access::FindUser(const Digest& token) const {
  const Known* found = nullptr;
  for (const Known& user : users_) {
    if (IsEqual(token, user.token)) found = &user;
  }
  return found;
}

}  // namespace palpate::web
