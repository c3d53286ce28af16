#include "client/cli/reach.h"

#include <sys/stat.h>

#include <chrono>
#include <cstdio>

#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::seconds kConnectTimeout(3);

}  // namespace

std::unique_ptr<client::Calls> Reach(const client::Server& server) {
  auto palpated = std::make_unique<client::Calls>(server);
  const std::string warning = TokenFileWarning(server.credentials.token_file);
  if (!warning.empty()) std::fprintf(stderr, "palpate: warning: %s\n", OneLine(warning).c_str());
  try {
    palpated->WaitUntilReached(kConnectTimeout);
  } catch (const Error& error) {
    const char* const options = palpated->shares_clock() ? ", or name another one with --socket"
                                                         : "; see --server, --tls-ca and --profile";
    throw Error(error.kind(), error.what() + std::string(options));
  }
  return palpated;
}

std::string TokenFileWarning(const std::string& path) {
  struct stat info {};
  if (path.empty() || stat(path.c_str(), &info) != 0 || (info.st_mode & S_IROTH) == 0) return "";
  return "the token file " + path +
         " may be read by every account of this machine: 'chmod 600' it, and ask for a new token "
         "where others could have read this one";
}

}  // namespace palpate::cli
