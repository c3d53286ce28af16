#include "server/security/token_file.h"

#include <fmt/chrono.h>
#include <fmt/core.h>
#include <sys/stat.h>
#include <unistd.h>

#include <toml++/toml.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <set>
#include <string_view>

#include "common/error/error.h"
#include "common/error/one_line.h"
#include "common/files/new_file.h"

namespace palpate {
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

}  // namespace

std::string ToText(std::chrono::sys_seconds time) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(time)));
}

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
