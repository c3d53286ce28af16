#include "client/cli/reach.h"

#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <functional>
#include <memory>

#include "client/cli/output.h"
#include "client/program/interrupt.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::seconds kConnectTimeout(3);
constexpr std::chrono::seconds kSayLoading(5);

// On a terminal, a line in place. Otherwise, a line at the beginning and then every five seconds.
std::function<bool(const std::string&)> LoadingLine() {
  using Clock = std::chrono::steady_clock;
  return [status = std::make_shared<StatusLine>(),
          shown = Clock::time_point()](const std::string& line) mutable {
    const auto now = Clock::now();
    if (line.empty()) {
      status->Clear();
      return true;
    }
    if (Interrupt::IsRaised()) throw Error(ErrorKind::kCancelled, "cancelled");
    if (IsTerminal(STDERR_FILENO)) {
      status->Show("palpated: " + line);
    } else if (now - shown > kSayLoading) {
      shown = now;
      std::fprintf(stderr, "palpated: %s\n", OneLine(line).c_str());
    }
    return true;
  };
}

}  // namespace

std::unique_ptr<client::Calls> Connect(const client::Server& server) {
  auto palpated = std::make_unique<client::Calls>(server);
  const std::string warning = TokenFileWarning(server.credentials.token_file);
  if (!warning.empty()) std::fprintf(stderr, "palpate: warning: %s\n", OneLine(warning).c_str());
  palpated->SetOnLoading(LoadingLine());
  return palpated;
}

std::unique_ptr<client::Calls> Reach(const client::Server& server) {
  std::unique_ptr<client::Calls> palpated = Connect(server);
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
