#include "server/security/token.h"

#include <fmt/chrono.h>
#include <fmt/core.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/rand.h>
#include <sys/stat.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <set>
#include <string_view>

#include "common/error/error.h"
#include "common/error/text.h"
#include "common/files/new_file.h"

namespace palpate {
namespace {

constexpr std::string_view kPrefix = "palpate_";
constexpr std::size_t kSecretBytes = 32;
constexpr std::size_t kSaltBytes = 16;
constexpr std::size_t kMostTokenLength = 128;

template <std::size_t kSize>
std::array<unsigned char, kSize> RandomBytes() {
  std::array<unsigned char, kSize> bytes{};
  if (RAND_bytes(bytes.data(), static_cast<int>(kSize)) != 1) {
    throw Error(ErrorKind::kInternal, "the system gave no random bytes: try again");
  }
  return bytes;
}

template <class Bytes>
std::string Hex(const Bytes& bytes) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

// Leaves out the padding, which carries no data.
template <class Bytes>
std::string Base64Url(const Bytes& bytes) {
  std::string text(4 * (bytes.size() / 3 + 1) + 1, '\0');
  const int length = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()), bytes.data(),
                                     static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  std::replace(text.begin(), text.end(), '+', '-');
  std::replace(text.begin(), text.end(), '/', '_');
  text.resize(std::min(text.size(), text.find('=')));
  return text;
}

}  // namespace

void CheckTokenName(const std::string& name) {
  const auto is_plain = [](unsigned char c) {
    return c < 128 && (std::isalnum(c) || c == '.' || c == '_' || c == '-');
  };
  if (name.empty() || name.size() > 64 || !std::all_of(name.begin(), name.end(), is_plain)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the name of a token has 1 to 64 letters, digits and ._- only");
  }
}

NewToken MakeToken(const std::string& name, Role role) {
  CheckTokenName(name);
  NewToken token;
  token.text = std::string(kPrefix) + Base64Url(RandomBytes<kSecretBytes>());
  token.stored = {name, role, Hex(RandomBytes<kSaltBytes>()), {}};
  token.stored.sha256_hex = HashToken(token.stored.salt_hex, token.text);
  return token;
}

std::string HashToken(std::string_view salt_hex, std::string_view token) {
  std::string text(salt_hex);
  text += token;
  std::array<unsigned char, 32> digest{};
  if (EVP_Digest(text.data(), text.size(), digest.data(), nullptr, EVP_sha256(), nullptr) != 1) {
    throw Error(ErrorKind::kInternal, "SHA-256 failed");
  }
  OPENSSL_cleanse(text.data(), text.size());
  return Hex(digest);
}

const StoredToken* FindToken(const std::vector<StoredToken>& tokens, std::string_view token) {
  // A client may send any amount of data. Only text that may be a token is hashed.
  if (!token.starts_with(kPrefix) || token.size() > kMostTokenLength) return nullptr;
  const StoredToken* found = nullptr;
  for (const StoredToken& stored : tokens) {
    const std::string hash = HashToken(stored.salt_hex, token);
    if (hash.size() == stored.sha256_hex.size() &&
        CRYPTO_memcmp(hash.data(), stored.sha256_hex.data(), hash.size()) == 0) {
      found = &stored;
    }
  }
  return found;
}

namespace {

[[noreturn]] void Fail(const std::filesystem::path& path, const std::string& what) {
  throw Error(ErrorKind::kInvalidArgument, path.string() + what);
}

bool IsHex(std::string_view text, std::size_t digits) {
  return text.size() == digits &&
         text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

std::chrono::sys_seconds ParseTime(const std::filesystem::path& path, const std::string& at,
                                   const toml::node_view<const toml::node>& node) {
  const auto value = node.value_exact<toml::date_time>();
  if (!value || !value->offset) {
    Fail(path, at + "expires must be a time, as in 2027-01-31T12:00:00Z, without quotes");
  }
  const std::chrono::year_month_day day(std::chrono::year(value->date.year),
                                        std::chrono::month(value->date.month),
                                        std::chrono::day(value->date.day));
  return std::chrono::sys_days(day) + std::chrono::hours(value->time.hour) +
         std::chrono::minutes(value->time.minute - value->offset->minutes) +
         std::chrono::seconds(value->time.second);
}

StoredToken ParseToken(const std::filesystem::path& path, const toml::table& table) {
  const std::string at = fmt::format(":{}: ", table.source().begin.line);
  const auto text = [&](std::string_view key) {
    const auto value = table[key].value_exact<std::string>();
    if (!value) Fail(path, at + "a token needs its " + std::string(key) + " as a text in quotes");
    return *value;
  };
  for (const auto& [key, node] : table) {
    if (key != "name" && key != "role" && key != "salt" && key != "sha256" && key != "expires") {
      Fail(path, at + std::string(key.str()) + " is not a key of a token");
    }
  }
  StoredToken token{text("name"), Role::kViewer, text("salt"), text("sha256")};
  try {
    CheckTokenName(token.name);
  } catch (const Error& error) {
    Fail(path, at + error.what());
  }
  const auto role = Named<Role>(text("role"));
  if (!role) Fail(path, at + "the role is viewer, editor, operator or admin");
  token.role = *role;
  if (table.contains("expires")) token.expires = ParseTime(path, at, table["expires"]);
  if (!IsHex(token.salt_hex, 32) || !IsHex(token.sha256_hex, 64)) {
    Fail(path, at + "salt and sha256 are 32 and 64 hex digits: make tokens with "
                    "'palpated token add'");
  }
  return token;
}

std::string Text(const std::vector<StoredToken>& tokens) {
  std::string text =
      "# Tokens of palpated's clients. Made by `palpated token add`, which showed each once;\n"
      "# these hashes do not give them back. A token that is taken out is refused within\n"
      "# seconds, and its streams end.\n";
  for (const StoredToken& token : tokens) {
    text +=
        fmt::format("\n[[token]]\nname = \"{}\"\nrole = \"{}\"\nsalt = \"{}\"\nsha256 = \"{}\"\n",
                    token.name, NameOf(token.role), token.salt_hex, token.sha256_hex);
    if (token.expires) text += "expires = " + ToText(*token.expires) + "\n";
  }
  return text;
}

// The owner and mode that the file must get.
struct stat Belongs(const std::filesystem::path& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) == 0) return status;
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  if (stat(folder.c_str(), &status) != 0) throw CannotWrite(path, errno);
  status.st_uid = geteuid();
  status.st_mode = 0640;
  return status;
}

// Throws kPermissionDenied if users other than root and this process's user may write the file at
// `path`, kNotFound if there is no file.
void CheckOnlyOwnerWrites(const std::filesystem::path& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) {
    throw Error(ErrorKind::kNotFound, "cannot read " + path.string() + ": " + std::strerror(errno) +
                                          "; 'palpated token add' makes such a file");
  }
  const bool owner_is_ours = status.st_uid == 0 || status.st_uid == geteuid();
  if (!owner_is_ours || (status.st_mode & 022) != 0 || !S_ISREG(status.st_mode)) {
    throw Error(ErrorKind::kPermissionDenied,
                path.string() +
                    " may be written by others: make it a file of root, or of the "
                    "daemon's user, with 'chmod go-w'");
  }
}

}  // namespace

std::string ToText(std::chrono::sys_seconds time) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(time)));
}

std::vector<StoredToken> ReadTokenFile(const std::filesystem::path& path) {
  CheckOnlyOwnerWrites(path);
  toml::table file;
  try {
    file = toml::parse_file(path.string());
  } catch (const toml::parse_error& error) {
    Fail(path, fmt::format(":{}: {}", error.source().begin.line, OneLine(error.description())));
  }
  std::vector<StoredToken> tokens;
  std::set<std::string> names;
  for (const auto& [key, node] : file) {
    const toml::array* array = key == "token" ? node.as_array() : nullptr;
    if (!array) Fail(path, fmt::format(":{}: expected [[token]] alone", node.source().begin.line));
    for (const toml::node& element : *array) {
      if (!element.is_table()) Fail(path, ": expected [[token]] alone");
      tokens.push_back(ParseToken(path, *element.as_table()));
      if (!names.insert(tokens.back().name).second) {
        Fail(path, ": two tokens are named " + tokens.back().name);
      }
    }
  }
  return tokens;
}

void WriteTokenFile(const std::filesystem::path& path, const std::vector<StoredToken>& tokens) {
  const struct stat belongs = Belongs(path);
  // If the name is a link, the link stays.
  NewFile file(std::filesystem::weakly_canonical(path), IfThere::kReplace, 0600);
  file.Write(Text(tokens));
  struct stat written {};
  // Changes the owner last. A user who may not give the file away keeps it.
  const bool done = fchmod(file.descriptor(), belongs.st_mode & 0777) == 0 &&
                    fstat(file.descriptor(), &written) == 0;
  const bool given = (written.st_uid == belongs.st_uid && written.st_gid == belongs.st_gid) ||
                     fchown(file.descriptor(), belongs.st_uid, belongs.st_gid) == 0 ||
                     geteuid() != 0;
  if (!done || !given) throw CannotWrite(path, errno);
  file.TakeName();
}

}  // namespace palpate
