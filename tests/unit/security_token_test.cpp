// Tokens and their file.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <fstream>
#include <set>

#include "common/error/error.h"
#include "server/security/policy.h"
#include "server/security/token.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

TEST(Token, IsFoundByItsTextAlone) {
  const NewToken a = MakeToken("a", Role::kEditor);
  const NewToken b = MakeToken("b", Role::kAdmin);
  const std::vector<StoredToken> stored = {a.stored, b.stored};
  ASSERT_TRUE(FindToken(stored, a.text));
  EXPECT_EQ(FindToken(stored, a.text)->name, "a");
  EXPECT_EQ(FindToken(stored, b.text)->role, Role::kAdmin);
  for (std::size_t n = 0; n < a.text.size(); ++n) {
    std::string other = a.text;
    other[n] = other[n] == 'A' ? 'B' : 'A';
    EXPECT_FALSE(FindToken(stored, other)) << n;
    EXPECT_FALSE(FindToken(stored, a.text.substr(0, n))) << n;
  }
  for (const std::string& bad : {a.text + "A", a.text + std::string(1, '\0'), std::string(),
                                 a.stored.sha256_hex, "palpate_" + std::string(100'000, 'A')}) {
    EXPECT_FALSE(FindToken(stored, bad));
  }
  // Of an entry whose hash is missing, nothing is the token.
  StoredToken empty = a.stored;
  empty.sha256_hex.clear();
  EXPECT_FALSE(FindToken({empty}, a.text));
}

TEST(Token, HasTheBitsItPromises) {
  std::set<std::string> seen;
  for (int n = 0; n < 200; ++n) {
    const NewToken token = MakeToken("n", Role::kViewer);
    EXPECT_TRUE(seen.insert(token.text).second);
    EXPECT_TRUE(seen.insert(token.stored.salt_hex).second);
    // 32 bytes are 43 digits of base64.
    EXPECT_EQ(token.text.size(), 8u + 43u);
    EXPECT_EQ(token.text.find_first_of("+/= \n"), std::string::npos);
    EXPECT_EQ(token.stored.sha256_hex.find(token.text), std::string::npos);
  }
}

TEST(Token, HashIsSha256OfSaltAndToken) {
  // From `printf 00palpate_x | sha256sum`.
  EXPECT_EQ(HashToken("00", "palpate_x"),
            "5f9187eecf2d1c257866b2c809f15bf007058882e53e66838483269af6d2dda2");
}

TEST(Token, ExpiresInItsFileAndForThePolicy) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "tokens.toml";
  NewToken guest = MakeToken("guest", Role::kEditor);
  const auto end = std::chrono::sys_days(std::chrono::year(2027) / 1 / 31) + std::chrono::hours(12);
  guest.stored.expires = end;
  const NewToken staff = MakeToken("staff", Role::kViewer);
  WriteTokenFile(file, {guest.stored, staff.stored});
  const std::vector<StoredToken> read = ReadTokenFile(file);
  EXPECT_EQ(read.at(0).expires, end);
  EXPECT_FALSE(read.at(1).expires);

  const Policy policy({.tokens = file});
  const auto recognise = [&](const NewToken& token, CertificateTime now) {
    return policy.Recognise({.entry = {Transport::kTls}, .authorization = "Bearer " + token.text},
                            now);
  };
  using std::chrono::seconds;
  EXPECT_TRUE(recognise(guest, end - seconds(1)).identity);
  EXPECT_FALSE(recognise(guest, end).identity);
  EXPECT_NE(recognise(guest, end).problem.find("2027-01-31T12:00:00Z"), std::string::npos);
  EXPECT_TRUE(recognise(staff, end).identity);
  // A stream that was admitted is judged again by the hash.
  const Credentials admitted{.entry = {Transport::kTls},
                             .token_sha256_hex = guest.stored.sha256_hex};
  EXPECT_TRUE(policy.Recognise(admitted, end - seconds(1)).identity);
  EXPECT_FALSE(policy.Recognise(admitted, end).identity);
}

class TokenFileTest : public ::testing::Test {
 protected:
  bool IsTaken() const {
    const std::string line = testing::Complaint([&] { ReadTokenFile(file_); });
    EXPECT_TRUE(line.empty() || line.find(file_) != line.npos) << line;
    return line.empty();
  }
  std::string Read() const { return test::TextOf(file_); }
  void Write(const std::string& text) const { std::ofstream(file_) << text; }

  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "tokens.toml";
};

TEST_F(TokenFileTest, KeepsWhatItWasGivenAndNotTheToken) {
  const NewToken a = MakeToken("lab-script", Role::kEditor);
  const NewToken b = MakeToken("b", Role::kAdmin);
  WriteTokenFile(file_, {a.stored, b.stored});
  const auto read = ReadTokenFile(file_);
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(FindToken(read, a.text)->name, "lab-script");
  EXPECT_EQ(FindToken(read, b.text)->role, Role::kAdmin);
  EXPECT_EQ(Read().find(a.text.substr(8)), std::string::npos);
  struct stat status {};
  ASSERT_EQ(stat(file_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0640u);
  // It keeps the mode it has, and leaves nothing beside it.
  chmod(file_.c_str(), 0600);
  WriteTokenFile(file_, {});
  ASSERT_EQ(stat(file_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  EXPECT_TRUE(ReadTokenFile(file_).empty());
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
}

TEST_F(TokenFileTest, AFileBehindALinkIsReplacedThere) {
  const std::filesystem::path real = folder_.path() / "real.toml";
  WriteTokenFile(real, {});
  std::filesystem::create_symlink(real, file_);
  WriteTokenFile(file_, {MakeToken("a", Role::kViewer).stored});
  EXPECT_TRUE(std::filesystem::is_symlink(file_));
  EXPECT_EQ(ReadTokenFile(real).size(), 1u);
}

TEST_F(TokenFileTest, IsRefusedWhereOthersMayWriteIt) {
  WriteTokenFile(file_, {});
  for (const mode_t mode : {0620u, 0602u, 0666u, 0660u}) {
    chmod(file_.c_str(), mode);
    EXPECT_FALSE(IsTaken()) << mode;
  }
  chmod(file_.c_str(), 0644);
  EXPECT_TRUE(IsTaken());
  if (geteuid() == 0) {
    ASSERT_EQ(chown(file_.c_str(), 1234, 1234), 0);
    EXPECT_FALSE(IsTaken());
  }
}

TEST_F(TokenFileTest, OnlyATimeEndsAToken) {
  NewToken guest = MakeToken("guest", Role::kEditor);
  guest.stored.expires = std::chrono::sys_days(std::chrono::year(2027) / 1 / 31);
  WriteTokenFile(file_, {guest.stored});
  const std::string written = Read();
  const std::string time = "2027-01-31T00:00:00Z";
  const auto write_with = [&](const std::string& other) {
    std::string text = written;
    Write(text.replace(text.find(time), time.size(), other));
  };
  for (const char* bad : {"2027-01-31", "\"2027-01-31T12:00:00Z\"", "2027-01-31T12:00:00", "1"}) {
    write_with(bad);
    EXPECT_FALSE(IsTaken()) << bad;
  }
  // With another offset it is the same moment.
  write_with("2027-01-31T02:30:00+02:30");
  EXPECT_EQ(ReadTokenFile(file_).at(0).expires, guest.stored.expires);
}

TEST_F(TokenFileTest, IsRefusedWhole) {
  const std::string salt(32, 'a'), hash(64, 'b');
  const std::string good = "[[token]]\nname = \"a\"\nrole = \"viewer\"\nsalt = \"" + salt +
                           "\"\nsha256 = \"" + hash + "\"\n";
  Write(good);
  EXPECT_TRUE(IsTaken());
  const auto with = [&](std::string from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  for (const std::string& bad :
       {with("viewer", "root"), with(salt, "aa"), with(hash, std::string(64, 'G')),
        with("\"a\"", "\"a b\""), with("\"a\"", "\"\""), with("\"a\"", "3"), with("role", "rolle"),
        with("[[token]]", "[token]"), with("[[token]]", "[[tokens]]"), good + good,
        good + "[[token", std::string("token = [1]\n"), good + "more = 1\n"}) {
    Write(bad);
    EXPECT_FALSE(IsTaken()) << bad;
  }
  std::filesystem::remove(file_);
  EXPECT_FALSE(IsTaken());
}

}  // namespace
}  // namespace palpate
