// Who may watch, and who may change what.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "client/sdk/settings.h"
#include "client/web/logins/access.h"
#include "tests/support/refusal.h"

namespace palpate::web {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

const Time kStart{hours(1000)};
const std::string kKey = "sixteen-letters!";
const std::string kToken = "a token of 256 bits";

AccessOptions Options() {
  AccessOptions options;
  options.room_key = kKey;
  options.users = {{"lecturer-1", ToHex(Sha256(kToken)), {"isovalue", "force_shading"}},
                   {"lecturer-2", ToHex(Sha256("another token")), {}}};
  return options;
}

TEST(WebSecret, DigestIsThatOfSha256) {
  // From `printf abc | sha256sum`.
  const std::string hex = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  EXPECT_EQ(ToHex(Sha256("abc")), hex);
  ASSERT_TRUE(DigestFromHex(hex));
  EXPECT_TRUE(IsEqual(*DigestFromHex(hex), Sha256("abc")));
  for (const std::string& bad : {hex.substr(1), hex + "0", "g" + hex.substr(1), std::string()}) {
    EXPECT_FALSE(DigestFromHex(bad)) << bad;
  }
}

TEST(WebSecret, AnyDifferenceIsSeen) {
  const Digest digest = Sha256("x");
  for (std::size_t n = 0; n < digest.size(); ++n) {
    for (int bit = 0; bit < 8; ++bit) {
      Digest other = digest;
      other[n] ^= static_cast<std::uint8_t>(1 << bit);
      EXPECT_FALSE(IsEqual(digest, other));
    }
  }
}

TEST(WebAccess, KeysAndTokensOpenTheirOwnDoor) {
  Access access(Options());
  const auto guest = access.LogIn(Access::Secret::kRoomKey, kKey, "a", kStart);
  ASSERT_EQ(guest.result, Access::Result::kWelcome);
  EXPECT_EQ(guest.session->may_steer, std::vector<std::string>());
  const auto lecturer = access.LogIn(Access::Secret::kToken, kToken, "a", kStart);
  ASSERT_EQ(lecturer.result, Access::Result::kWelcome);
  EXPECT_EQ(lecturer.session->user, "lecturer-1");
  const auto other = access.LogIn(Access::Secret::kRoomKey, kKey, "a", kStart);
  EXPECT_NE(other.session->user, guest.session->user);

  const auto result = [&](Access::Secret kind, const std::string& secret) {
    static int address = 0;
    return access.LogIn(kind, secret, std::to_string(++address), kStart).result;
  };
  EXPECT_EQ(result(Access::Secret::kRoomKey, kToken), Access::Result::kWrong);
  EXPECT_EQ(result(Access::Secret::kToken, kKey), Access::Result::kWrong);
  EXPECT_EQ(result(Access::Secret::kToken, ToHex(Sha256(kToken))), Access::Result::kWrong);
  for (std::size_t n = 0; n <= kKey.size(); ++n) {
    std::string changed = kKey.substr(0, n);
    EXPECT_EQ(result(Access::Secret::kRoomKey, n < kKey.size() ? changed : kKey + "x"),
              Access::Result::kWrong);
    if (n == kKey.size()) continue;
    changed = kKey;
    changed[n] ^= 1;
    EXPECT_EQ(result(Access::Secret::kRoomKey, changed), Access::Result::kWrong);
  }
}

// Logins of the room's key are cheap: who has it may make many at one place.
TEST(WebAccess, GuestsShareWithTheirNetworkAndUsersWithNobody) {
  Access access(Options());
  const auto network = [&](Access::Secret kind, const std::string& secret) {
    return access.LogIn(kind, secret, "hall", kStart).session->network;
  };
  EXPECT_EQ(network(Access::Secret::kRoomKey, kKey), "hall");
  const std::string users = network(Access::Secret::kToken, kToken);
  EXPECT_NE(users, "hall");
  EXPECT_NE(users, network(Access::Secret::kToken, "another token"));
}

TEST(WebAccess, WithoutRoomAndUsersNobodyGetsIn) {
  Access access({});
  EXPECT_EQ(access.LogIn(Access::Secret::kRoomKey, "", "a", kStart).result, Access::Result::kWrong);
  EXPECT_EQ(access.LogIn(Access::Secret::kToken, "", "b", kStart).result, Access::Result::kWrong);
}

TEST(WebAccess, OptionsThatCannotBeMeantAreRefused) {
  const auto refuses = [](auto change) {
    AccessOptions options = Options();
    change(options);
    return testing::Refusal([&] { Access access(options); }) == ErrorKind::kInvalidArgument;
  };
  EXPECT_FALSE(refuses([](AccessOptions&) {}));
  EXPECT_TRUE(refuses([](AccessOptions& options) { options.room_key = "too short"; }));
  EXPECT_TRUE(refuses([](AccessOptions& options) { options.users[0].name = "<script>"; }));
  EXPECT_TRUE(refuses([](AccessOptions& options) { options.users[0].name = "guest-1"; }));
  EXPECT_TRUE(refuses([](AccessOptions& options) { options.users[1].name = "lecturer-1"; }));
  EXPECT_TRUE(refuses([](AccessOptions& options) { options.users[0].token_sha256_hex = kToken; }));
  EXPECT_TRUE(refuses([](AccessOptions& options) { options.users[0].may_steer = {"forces"}; }));
}

TEST(WebAccess, SessionsEnd) {
  Access access(Options());
  const auto login = access.LogIn(Access::Secret::kRoomKey, kKey, "a", kStart);
  EXPECT_EQ(login.cookie.size(), 32u);
  EXPECT_EQ(access.Find(login.cookie, kStart + hours(12) - milliseconds(1)), login.session);
  EXPECT_FALSE(login.session->IsOver(kStart + hours(12) - milliseconds(1)));
  EXPECT_TRUE(login.session->IsOver(kStart + hours(12)));
  EXPECT_FALSE(access.Find(login.cookie, kStart + hours(12)));

  const auto second = access.LogIn(Access::Secret::kRoomKey, kKey, "a", kStart);
  access.LogOut(second.cookie);
  EXPECT_TRUE(second.session->IsOver(kStart));
  EXPECT_FALSE(access.Find(second.cookie, kStart));
  EXPECT_FALSE(access.Find("", kStart));
  EXPECT_FALSE(access.Find(ToHex(Sha256(login.cookie)), kStart));
}

TEST(WebSessions, AreAsManyAsMayBe) {
  Sessions sessions(hours(1), 100);
  const Sessions::Opened held = sessions.Open("held", {}, "a", kStart);
  std::vector<std::string> secrets;
  for (int n = 1; n <= 300; ++n) {
    secrets.push_back(sessions.Open("guest", {}, "a", kStart + seconds(n)).secret);
    EXPECT_LE(sessions.size(), 100u);
  }
  const Time end = kStart + seconds(300);
  // What a connection holds stays, and the newest of the others.
  EXPECT_TRUE(sessions.Find(held.secret, end));
  for (std::size_t n = 0; n < secrets.size(); ++n) {
    EXPECT_EQ(sessions.Find(secrets[n], end) != nullptr, n >= 201) << n;
  }
  EXPECT_EQ(std::set<std::string>(secrets.begin(), secrets.end()).size(), 300u);
}

TEST(WebAccess, WrongKeysAreFewPerAddressAndMinute) {
  Access access(Options());
  const auto attempt = [&](const std::string& key, const std::string& address, Time now) {
    return access.LogIn(Access::Secret::kRoomKey, key, address, now).result;
  };
  // A lecture hall has one address.
  for (int n = 0; n < 300; ++n) EXPECT_EQ(attempt(kKey, "hall", kStart), Access::Result::kWelcome);
  for (int n = 0; n < 10; ++n) EXPECT_EQ(attempt("wrong", "a", kStart), Access::Result::kWrong);
  // Old keys of some lock out nobody.
  const Time end = kStart + minutes(1) - milliseconds(1);
  for (const Time now : {kStart, end}) {
    EXPECT_EQ(attempt("wrong", "a", now), Access::Result::kTooManyAttempts);
    EXPECT_EQ(attempt(kKey, "a", now), Access::Result::kWelcome);
    EXPECT_EQ(access.LogIn(Access::Secret::kToken, kToken, "a", now).result,
              Access::Result::kWelcome);
  }
  EXPECT_EQ(attempt("wrong", "b", end), Access::Result::kWrong);
  EXPECT_EQ(attempt("wrong", "a", kStart + minutes(1)), Access::Result::kWrong);
}

TEST(WebAccess, AFloodOfAddressesIsBounded) {
  LoginAttempts attempts;
  for (std::size_t n = 0; n < LoginAttempts::kMostAddresses; ++n) {
    EXPECT_TRUE(attempts.IsFew(std::to_string(n), kStart));
  }
  EXPECT_FALSE(attempts.IsFew("one more", kStart));
  EXPECT_TRUE(attempts.IsFew("7", kStart));
  EXPECT_TRUE(attempts.IsFew("one more", kStart + minutes(1)));
}

Session SessionOf(const std::string& user, std::vector<std::string> may_steer) {
  Session session;
  session.user = user;
  session.may_steer = std::move(may_steer);
  return session;
}

TEST(WebSteering, OnlyWhatWasAllowed) {
  SteeringRules rules;
  const Session guest = SessionOf("guest-1", {});
  const Session lecturer = SessionOf("lecturer", {"isovalue", "nonsense"});
  EXPECT_NE(rules.Refusal(guest, "isovalue", 1.0, kStart), "");
  EXPECT_EQ(rules.Refusal(lecturer, "isovalue", 1.0, kStart), "");
  for (const std::string key :
       {"pop_force_n", "nonsense", "", "isovalu", "Isovalue", "isovalue "}) {
    EXPECT_NE(rules.Refusal(lecturer, key, 1.0, kStart), "") << key;
  }
}

TEST(WebSteering, WhereThePatientFacesIsOneOf36) {
  SteeringRules rules;
  const Session lecturer = SessionOf("lecturer", {"facing"});
  EXPECT_TRUE(IsSetting("facing"));
  for (const double good : {0.0, 22.0, 35.0}) {
    EXPECT_EQ(rules.Refusal(lecturer, "facing", good, kStart), "");
  }
  for (const double bad : {-1.0, 36.0, 0.5, std::nan("")}) {
    EXPECT_NE(rules.Refusal(lecturer, "facing", bad, kStart), "") << bad;
  }
  EXPECT_NE(rules.Refusal(SessionOf("guest", {"isovalue"}), "facing", 0.0, kStart), "");
}

// Each setting's edges, from the list that palpated has.
TEST(WebSteering, OnlyValuesInRange) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto is_allowed = [](const client::Setting& setting, double value) {
    SteeringRules rules;
    const std::string key(setting.key);
    return rules.Refusal(SessionOf("l", {key}), key, value, kStart).empty();
  };
  for (const client::Setting& setting : client::kSettings) {
    SCOPED_TRACE(setting.key);
    for (const double never : {std::nan(""), kInfinity, -kInfinity}) {
      EXPECT_FALSE(is_allowed(setting, never));
    }
    if (const auto* number = std::get_if<client::NumberSetting>(&setting.kind)) {
      const bool has_range = std::isfinite(number->minimum);
      EXPECT_TRUE(is_allowed(setting, has_range ? number->minimum : -1e9));
      EXPECT_TRUE(is_allowed(setting, has_range ? number->maximum : 1e9));
      EXPECT_FALSE(is_allowed(setting, std::nextafter(number->minimum, -kInfinity)));
      EXPECT_FALSE(is_allowed(setting, std::nextafter(number->maximum, kInfinity)));
      continue;
    }
    const auto* choice = std::get_if<client::ChoiceSetting>(&setting.kind);
    const double count = choice != nullptr ? static_cast<double>(choice->words.size()) : 2.0;
    for (double value = 0.0; value < count; ++value) EXPECT_TRUE(is_allowed(setting, value));
    for (const double bad : {-1.0, count, 0.5, 1e300})
      EXPECT_FALSE(is_allowed(setting, bad)) << bad;
  }
}

// In all sessions of a user together, and again one second later.
TEST(WebAccess, TenChangesASecond) {
  Access access(Options());
  const SessionPtr sessions[] = {access.LogIn(Access::Secret::kToken, kToken, "a", kStart).session,
                                 access.LogIn(Access::Secret::kToken, kToken, "b", kStart).session};
  const auto made = [&](Time now) {
    int count = 0;
    for (int n = 0; n < 60; ++n) {
      count += access.SteeringRefusal(*sessions[n % 2], "isovalue", n, now).empty() ? 1 : 0;
    }
    return count;
  };
  EXPECT_EQ(made(kStart), 10);
  EXPECT_EQ(made(kStart + milliseconds(999)), 0);
  EXPECT_EQ(made(kStart + seconds(1)), 10);
}

// At random times: never more than ten within a second, and never fewer than may be.
TEST(WebSteering, TenASecondOfAUser) {
  SteeringRules rules;
  const Session here = SessionOf("lecturer", {"isovalue"});
  const Session there = here;
  std::mt19937 random(7);
  std::vector<Time> made;
  Time now = kStart;
  for (int n = 0; n < 5000; ++n) {
    now += milliseconds(random() % 120);
    const Session& session = random() % 2 == 0 ? here : there;
    const bool is_full = made.size() >= 10 && now - made[made.size() - 10] < seconds(1);
    const bool is_made = rules.Refusal(session, "isovalue", n, now).empty();
    EXPECT_EQ(is_made, !is_full);
    if (is_made) made.push_back(now);
  }
  EXPECT_EQ(rules.Refusal(SessionOf("other", {"isovalue"}), "isovalue", 0.0, now), "");
}

}  // namespace
}  // namespace palpate::web
