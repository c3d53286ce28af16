#include "server/volume/load/importer.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <system_error>
#include <utility>

#include "common/error/error.h"
#include "common/files/child_process.h"

namespace palpate {
namespace {

constexpr std::size_t kLongestLine = 8192;
constexpr std::size_t kMostLines = 64;
constexpr auto kPollInterval = std::chrono::milliseconds(50);
constexpr std::string_view kMessagePrefix = "palpate-import: ";
constexpr std::string_view kWarningPrefix = "warning: ";

[[noreturn]] void Fail(const std::string& what, int error) {
  const bool lacks = error == EMFILE || error == ENFILE || error == ENOMEM || error == EAGAIN;
  throw Error(lacks ? ErrorKind::kTooLarge : ErrorKind::kInternal,
              what + ": " + std::strerror(error));
}

// A pipe for what we write. As a socket, its end sends no SIGPIPE.
Pipe MakeSocket() {
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    Fail("cannot make a socket", errno);
  }
  return {Descriptor(ends[0]), Descriptor(ends[1])};
}

Pipe MakeOutPipe() {
  try {
    return MakePipe();
  } catch (const std::system_error& error) {
    Fail("cannot make a pipe", error.code().value());
  }
}

ChildProcess Start(const std::vector<std::string>& arguments,
                   const std::array<int, 4>& descriptors) {
  try {
    // In our session: its niceness counts beside us.
    return {arguments, descriptors, ChildProcess::Group::kOwnGroup};
  } catch (const std::system_error& error) {
    Fail("cannot start " + arguments.front() + " (is Palpate installed completely?)",
         error.code().value());
  }
}

// Splits the text from a pipe into lines of limited length.
class Lines {
 public:
  // False if the pipe has ended.
  bool ReadFrom(const Descriptor& pipe, const std::function<void(std::string_view)>& on_line) {
    std::array<char, 4096> buffer;
    const ssize_t count = read(pipe.get(), buffer.data(), buffer.size());
    if (count < 0) return errno == EAGAIN || errno == EINTR;
    for (ssize_t i = 0; i < count; ++i) {
      if (buffer[i] != '\n') {
        if (line_.size() < kLongestLine) line_ += buffer[i];
        continue;
      }
      on_line(line_);
      line_.clear();
    }
    if (count == 0 && !line_.empty()) on_line(line_);
    return count > 0;
  }

 private:
  std::string line_;
};

void AddMessage(std::string_view line, ChildEnd& end) {
  if (!line.starts_with(kMessagePrefix)) return;
  line.remove_prefix(kMessagePrefix.size());
  auto& list = line.starts_with(kWarningPrefix) ? end.warnings : end.messages;
  if (line.starts_with(kWarningPrefix)) line.remove_prefix(kWarningPrefix.size());
  if (list.size() < kMostLines) list.emplace_back(line);
}

// Sends the input as the process takes it.
class Feed {
 public:
  explicit Feed(const std::function<std::string_view()>& next) : next_(next) {}

  // False at the end. A process that takes no more says why at its end.
  bool SendTo(const Descriptor& socket) {
    if (rest_.empty()) rest_ = next_();
    if (rest_.empty()) return false;
    const ssize_t sent =
        send(socket.get(), rest_.data(), rest_.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0) {
      return errno == EAGAIN || errno == EINTR || errno == ENOBUFS || errno == ENOMEM;
    }
    rest_.remove_prefix(static_cast<std::size_t>(sent));
    return true;
  }

 private:
  const std::function<std::string_view()>& next_;
  std::string_view rest_;
};

ErrorKind KindOf(int exit_code) {
  for (const ErrorKind kind :
       {ErrorKind::kInvalidArgument, ErrorKind::kNotFound, ErrorKind::kPermissionDenied,
        ErrorKind::kTooLarge, ErrorKind::kConflict, ErrorKind::kUnavailable, ErrorKind::kCancelled,
        ErrorKind::kDiskFull}) {
    if (ExitCode(kind) == exit_code) return kind;
  }
  return ErrorKind::kInternal;
}

}  // namespace

ChildEnd RunChild(const ChildRun& run) {
  Pipe in = run.input ? MakeSocket() : Pipe();
  Pipe out = MakeOutPipe();
  Pipe err = MakeOutPipe();
  ChildProcess process =
      Start(run.arguments, {in.read.get(), out.write.get(), err.write.get(), run.descriptor});
  in.read.Close();
  out.write.Close();
  err.write.Close();

  ChildEnd end;
  Lines out_lines;
  Lines err_lines;
  Feed feed(run.input);
  const auto on_line = [&](std::string_view line) {
    if (run.on_line) run.on_line(line);
  };
  const auto on_message = [&](std::string_view line) { AddMessage(line, end); };
  for (;;) {
    // A closed descriptor is -1, which poll ignores.
    std::array<pollfd, 3> fds = {
        {{out.read.get(), POLLIN, 0}, {err.read.get(), POLLIN, 0}, {in.write.get(), POLLOUT, 0}}};
    poll(fds.data(), fds.size(), static_cast<int>(kPollInterval.count()));
    if (fds[0].revents && !out_lines.ReadFrom(out.read, on_line)) out.read.Close();
    if (fds[1].revents && !err_lines.ReadFrom(err.read, on_message)) err.read.Close();
    if (fds[2].revents && !feed.SendTo(in.write)) in.write.Close();
    if (run.check) run.check();
    if (out.read.get() >= 0 || err.read.get() >= 0) continue;
    if (const auto status = process.Poll()) {
      end.status = *status;
      return end;
    }
  }
}

void ThrowUnlessSuccess(const ChildEnd& end, const std::string& what, const std::string& shortage,
                        const std::string& crash) {
  if (WIFSIGNALED(end.status)) {
    const int signal = WTERMSIG(end.status);
    if (signal == SIGKILL || signal == SIGXCPU || signal == SIGXFSZ) {
      throw Error(ErrorKind::kTooLarge, what + ": " + shortage);
    }
    throw Error(ErrorKind::kInternal, what + ": " + crash + " (" + strsignal(signal) + ")");
  }
  const int code = WEXITSTATUS(end.status);
  if (code == 0) return;
  throw Error(KindOf(code), end.messages.empty()
                                ? what + ": palpate-import failed with exit code " +
                                      std::to_string(code) + " and said nothing"
                                : end.messages.back());
}

bool ParseProgress(std::string_view line, double& fraction, std::string_view& stage) {
  constexpr std::string_view kWord = "progress ";
  if (!line.starts_with(kWord)) return false;
  line.remove_prefix(kWord.size());
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), fraction);
  if (error != std::errc() || !(fraction >= 0.0 && fraction <= 1.0)) return false;
  line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  if (line.starts_with(' ')) line.remove_prefix(1);
  stage = line;
  return true;
}

}  // namespace palpate
